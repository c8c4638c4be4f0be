"""affine and product: R matrix products at once, by the code that is fastest on this processor.

torch multiplies float32 matrices on the CPU with Intel's MKL, which uses 512-bit registers on
Intel's processors only. On those of AMD that have them, `product_tiles` takes MKL's place: it is 2
to 2.7 times faster on most layers of 64 and 128 units, and faster than torch's private operators of
oneDNN, which multiply one matrix at a time. Elsewhere, on other devices, for other types, and
with several threads, torch's products are used. Results agree within rounding.
"""

from typing import Any

import llvmlite.binding
import torch
from torch import Tensor
from torch.nn.functional import pad

from swarmdata.learn.products.product_tiles import LANES, multiply

HAS_TILES = torch.backends.cpu.get_cpu_capability() == "AVX512" and (
    llvmlite.binding.get_host_cpu_name().startswith("znver")
)
"""Whether this is a processor of AMD with 512-bit registers (Zen 4 and later)."""


def affine(x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """Returns x weight + bias of R networks, [R, B, outputs].

    Args:
        x: [R, B, inputs].
        weight: [R, inputs, outputs].
        bias: [R, 1, outputs].
    """
    if _suit(x, weight, bias):
        return _tiled(x, weight, bias)
    return torch.bmm(x, weight).add_(bias)


def product(x: Tensor, weight: Tensor) -> Tensor:
    """Returns x weight of R networks, [R, B, outputs]; arguments as of `affine`."""
    if _suit(x, weight):
        return _tiled(x, weight, None)
    return torch.bmm(x, weight)


def _suit(*operands: Tensor) -> bool:
    """Whether `product_tiles` multiplies these operands here."""
    return (
        HAS_TILES
        and operands[0].shape[2] > 0  # tiles begin with the first term
        and (torch.compiler.is_compiling() or torch.get_num_threads() == 1)
        and all(part.dtype == torch.float32 and part.device.type == "cpu" for part in operands)
    )


def _tiled(x: Tensor, weight: Tensor, bias: Tensor | None) -> Tensor:
    if torch.compiler.is_compiling():
        compiled: Tensor = compiled_product(x, weight, bias)
        return compiled
    eager: Tensor = _TiledProduct.apply(x, weight, bias)  # type: ignore[no-untyped-call]
    return eager


def tiled_product(x: Tensor, weight: Tensor, bias: Tensor | None = None) -> Tensor:
    """Returns x weight + bias, [R, B, outputs], of float32 on the CPU; no gradient flows.

    Args:
        x: [R, B, inputs], with one input at least.
        weight: [R, inputs, outputs].
        bias: [R, 1, outputs]; None adds nothing.
    """
    n_outputs = weight.shape[2]
    if n_outputs < LANES:
        lacking = (0, LANES - n_outputs)
        wide = tiled_product(x, pad(weight, lacking), None if bias is None else pad(bias, lacking))
        return wide[..., :n_outputs].contiguous()
    if weight.stride(2) != 1:
        weight = weight.contiguous()
    start = x.new_zeros(n_outputs).expand(len(x), 1, -1) if bias is None else bias
    if start.stride(2) != 1:
        start = start.contiguous()
    outputs = x.new_empty(*x.shape[:2], n_outputs)
    multiply(
        (*outputs.shape, x.shape[2]),
        x.data_ptr(), x.stride(),
        weight.data_ptr(), weight.stride()[:2],
        start.data_ptr(), start.stride(0),
        outputs.data_ptr(),
    )  # fmt: skip
    return outputs


def _gradients(ctx: Any, *grad_outputs: Any) -> tuple[Tensor | None, ...]:
    """Gradients of `tiled_product`, of those operands that need one."""
    (gradient,), (x, weight) = grad_outputs, ctx.saved_tensors
    of_x, of_weight, of_bias = ctx.needs_input_grad
    return (
        product(gradient, weight.transpose(1, 2)) if of_x else None,
        product(x.transpose(1, 2), gradient) if of_weight else None,
        gradient.sum(1, keepdim=True) if of_bias else None,
    )


class _TiledProduct(torch.autograd.Function):
    """`tiled_product` with its gradient."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, bias: Tensor | None) -> Tensor:
        ctx.save_for_backward(x, weight)
        return tiled_product(x, weight, bias)

    backward = staticmethod(_gradients)


@torch.library.custom_op("swarmdata::tiled_product", mutates_args=())
def compiled_product(x: Tensor, weight: Tensor, bias: Tensor | None) -> Tensor:
    """`tiled_product` for graphs of torch.compile, with its gradient; slower to call than that.

    No operand has a default: torch leaves out trailing operands that equal theirs, and gradients
    of two would not fit.
    """
    return tiled_product(x, weight, bias)


@compiled_product.register_fake
def _(x: Tensor, weight: Tensor, bias: Tensor | None) -> Tensor:
    return x.new_empty(*x.shape[:2], weight.shape[2])


compiled_product.register_autograd(
    _gradients, setup_context=lambda ctx, inputs, output: ctx.save_for_backward(*inputs[:2])
)
