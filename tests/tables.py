"""Nested tables and arrays, as files hold them, with something changed."""

import copy

ABSENT = object()


def put(content, keys, value):
    """A copy in which another value stands at a place, or none if it is `ABSENT`."""
    content = copy.deepcopy(content)
    *parents, last = keys
    inner = content
    for key in parents:
        inner = inner[key]
    if value is ABSENT:
        del inner[last]
    else:
        inner[last] = value
    return content
