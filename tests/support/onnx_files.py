"""Files of ONNX that answer otherwise than they did."""

from pathlib import Path

import onnx


def with_last_nodes(file: Path, *nodes: onnx.NodeProto) -> None:
    """Appends nodes to a file of ONNX that make its `action` of what was it, `plain`."""
    model = onnx.load(file)
    for node in model.graph.node:
        node.output[:] = ["plain" if name == "action" else name for name in node.output]
    model.graph.node.extend(nodes)
    onnx.save(model, file)
