"""A validation error as one line: which key, which value, which bound."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from uwcoop.scenario.secrets import redact

if TYPE_CHECKING:
    from pydantic import ValidationError
    from pydantic_core import ErrorDetails

_BOUNDS = {
    "greater_than": ("above", "gt"),
    "greater_than_equal": ("at least", "ge"),
    "less_than": ("below", "lt"),
    "less_than_equal": ("at most", "le"),
}
_KINDS = {
    "float_type": "a number",
    "float_parsing": "a number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "string_type": "a text",
    "bool_type": "true or false",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "tuple_type": "a list",
    "finite_number": "finite",
}


def one_line(error: ValidationError, data: Any, where: str) -> str:
    """The first thing wrong in one line, and how many more there are.

    Args:
        error: what pydantic found.
        data: the raw tables, to tell keys from pydantic's own tags.
        where: name of the file or scenario, which starts the line.
    """
    details = error.errors(include_url=False)
    rest = f" (and {len(details) - 1} more)" if len(details) > 1 else ""
    # A key may hold anything that a text can, line ends included.
    return " ".join(f"{where}: {_sentence(details[0], data)}{rest}".split())


def _sentence(detail: ErrorDetails, data: Any) -> str:
    kind, context = detail["type"], detail.get("ctx", {})
    key = _dotted(detail["loc"], data, last_is_key=kind == "missing")
    value = _shown(detail["input"])
    if kind == "unknown_key":
        name = context["key"]
        return f"unknown key '{key + '.' if key else ''}{name}': {context['hint']}"
    if kind == "missing":
        return f"key '{key}' is missing"
    if kind in _BOUNDS:
        word, name = _BOUNDS[kind]
        return f"{key} is {value}: must be {word} {context[name]:g}"
    if kind in _KINDS:
        return f"{key} is {value}: must be {_KINDS[kind]}"
    if kind == "literal_error":
        return f"{key} is {value}: must be one of {context['expected'].replace(' or ', ', ')}"
    if kind == "union_tag_invalid":
        tag = str(context.get("discriminator", "")).strip("'")
        name = tag if tag.isidentifier() else "model"
        return f"{key}.{name} is '{context['tag']}': must be one of {context['expected_tags']}"
    if kind == "union_tag_not_found":
        tag = str(context.get("discriminator", "")).strip("'")
        if not isinstance(detail["input"], dict):
            return f"{key} is {value}: must be a table"
        return f"key '{key}.{tag}' is missing"
    if kind == "too_short":
        return f"{key} has {context['actual_length']} entries: must have at least {context['min_length']}"
    if kind == "too_long":
        return (
            f"{key} has more than {context['max_length']} entries: must have at most {context['max_length']}"
        )
    if kind == "string_pattern_mismatch":
        return f"{key} is {value}: must be letters, digits, '-' or '_' only"
    if kind == "string_too_short":
        return f"{key} is empty: must not be"
    message = str(context["error"]) if "error" in context else detail["msg"]
    return f"{key} {message}" if key else message


def _dotted(location: tuple[int | str, ...], data: Any, *, last_is_key: bool) -> str:
    """The location as the author would write it, without the tags that pydantic adds for its unions."""
    keys: list[str] = []
    for k, part in enumerate(location):
        if isinstance(data, dict) and part in data:
            data = data[part]
        elif isinstance(data, list | tuple) and isinstance(part, int) and 0 <= part < len(data):
            data = list(data)[part]
        elif not (last_is_key and k == len(location) - 1):
            continue
        keys.append(str(part))
    return ".".join(keys)


def _shown(value: Any) -> str:
    text = f"{value:g}" if isinstance(value, float) else repr(value)
    text = redact(" ".join(text.split()))
    return text if len(text) <= 60 else f"{text[:57]}..."
