"""The depth of plain data, measured without recursion: deep data overflow the stack of what reads them."""

from typing import Any


def is_deeper(data: Any, levels: int) -> bool:
    """Return whether lists and dictionaries lie within each other in more than so many levels."""
    containers = [data] if isinstance(data, dict | list) else []
    for _ in range(levels):
        children = (node.values() if isinstance(node, dict) else node for node in containers)
        containers = [child for held in children for child in held if isinstance(child, dict | list)]
    return bool(containers)
