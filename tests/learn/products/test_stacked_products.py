"""Products and their gradients against torch's own, eager and compiled."""

from collections.abc import Callable

import pytest

torch = pytest.importorskip("torch", reason="products of torch's tensors")

from torch import Tensor  # noqa: E402

from swarmdata.learn.products import stacked_products  # noqa: E402
from swarmdata.learn.products.stacked_products import affine, product, tiled_product  # noqa: E402


@pytest.fixture
def with_tiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Tiles on any processor; LLVM makes them of what registers there are."""
    monkeypatch.setattr(stacked_products, "HAS_TILES", True)
    monkeypatch.setattr(torch, "get_num_threads", lambda: 1)


def operands(n_outputs: int) -> list[Tensor]:
    generator = torch.Generator().manual_seed(0)
    shapes = [(3, 11, 20), (3, 20, n_outputs), (3, 1, n_outputs)]
    return [torch.randn(shape, generator=generator).requires_grad_() for shape in shapes]


@pytest.mark.usefixtures("with_tiles")
@pytest.mark.parametrize("n_outputs", [1, 2, 16, 18, 70])
def test_products_and_gradients_equal_those_of_torch(n_outputs: int) -> None:
    x, weight, bias = operands(n_outputs)
    for ours, theirs, parts in (
        (affine(x, weight, bias), torch.bmm(x, weight) + bias, [x, weight, bias]),
        (product(x, weight), torch.bmm(x, weight), [x, weight]),
    ):
        torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-5)
        gradients = [torch.autograd.grad(y.square().sum(), parts) for y in (ours, theirs)]
        torch.testing.assert_close(*gradients, rtol=1e-4, atol=1e-4)


def test_views_of_a_buffer_are_multiplied_where_they_lie() -> None:
    flat = torch.randn(3, 20 * 32 + 7)
    weight = flat[:, 7:].view(3, 20, 32)
    x = torch.randn(11, 3, 20).transpose(0, 1)
    torch.testing.assert_close(tiled_product(x, weight), torch.bmm(x, weight))
    turned = torch.randn(3, 32, 20).transpose(1, 2)
    torch.testing.assert_close(tiled_product(x, turned), torch.bmm(x, turned))


@pytest.mark.usefixtures("with_tiles")
def test_other_types_are_left_to_torch() -> None:
    x, weight, bias = (part.detach().double() for part in operands(18))
    assert torch.equal(affine(x, weight, bias), torch.bmm(x, weight) + bias)


@pytest.mark.usefixtures("with_tiles")
@pytest.mark.parametrize("n_operands", [3, 2])
def test_graphs_of_torch_compile_have_the_same_products(n_operands: int) -> None:
    multiplied: Callable[..., Tensor] = affine if n_operands == 3 else product
    parts = operands(18)[:n_operands]
    compiled = torch.compile(multiplied, backend="aot_eager", fullgraph=True)
    results = [function(*parts) for function in (compiled, multiplied)]
    assert torch.equal(*results)
    gradients = [torch.autograd.grad(y.square().sum(), parts) for y in results]
    torch.testing.assert_close(*gradients)


@pytest.mark.usefixtures("with_tiles")
def test_without_inputs_or_rows_products_are_those_of_torch() -> None:
    """A layer without inputs is its bias, as in deviations that depend on nothing."""
    bias = torch.randn(3, 1, 18, requires_grad=True)
    x, weight = torch.zeros(3, 11, 0), torch.zeros(3, 0, 18, requires_grad=True)
    assert torch.equal(affine(x, weight, bias), bias.expand(3, 11, 18))
    x, weight, bias = torch.zeros(3, 0, 20), *operands(18)[1:]
    gradients = torch.autograd.grad(affine(x, weight, bias).sum(), (weight, bias))
    assert not any(each.any() for each in gradients)


def test_a_bias_may_be_a_view() -> None:
    x, weight, _ = operands(18)
    bias = torch.randn(3, 1, 36)[..., ::2]
    torch.testing.assert_close(tiled_product(x, weight, bias), torch.bmm(x, weight) + bias)
