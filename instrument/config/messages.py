"""Turns what pydantic finds wrong into messages with a line, a key and what is allowed."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from difflib import get_close_matches
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from instrument.config.toml_lines import KeyPath

Model = TypeVar("Model", bound=BaseModel)

# Pydantic's own words where they would puzzle the author of a TOML file.
_EXPECTED = {
    "float_type": "it must be a number",
    "int_type": "it must be a whole number",
    "string_type": 'it must be a text in "quotes"',
    "tuple_type": "it must be a list in [brackets]",
    "model_type": "it must be a table",
    "dict_type": "it must be a table",
}


def validate(model: type[Model], data: Any) -> Model:
    """Return the values of `data`, as `tomllib` gives them.

    By way of JSON, because only there does pydantic's strict mode take a list for a tuple while it
    still refuses a text or a boolean for a number.

    Raises
    ------
    ValidationError
        With everything that is wrong.
    """
    return model.model_validate_json(json.dumps(data, default=str), strict=True)


def valid_or_none(model: type[Model], data: Any) -> Model | None:
    """Return the values of `data`, or None if anything is wrong with them."""
    try:
        return validate(model, data)
    except ValidationError:
        return None


def complaints(model: type[BaseModel], error: ValidationError) -> Iterator[tuple[KeyPath, str]]:
    """Yield the path of each wrong key with a sentence; `model` is what was to be validated."""
    for details in error.errors(include_url=False):
        yield details["loc"], _sentence(model, details)


def _sentence(model: type[BaseModel], details: ErrorDetails) -> str:
    path, kind = details["loc"], details["type"]
    if kind == "extra_forbidden":
        return _unknown_key(model, path)
    if kind == "missing":
        return _missing_key(model, path)
    if kind == "value_error" and (not path or isinstance(details["input"], dict)):
        return _join(dotted(path), str(details["ctx"]["error"]))
    return f"{dotted(path)} is {_shown(details['input'])}; {_allowed(details)}{_meaning(model, path)}"


def _unknown_key(model: type[BaseModel], path: KeyPath) -> str:
    name, known = str(path[-1]), list(_model_at(model, path[:-1]).model_fields)
    close = get_close_matches(name, known, n=1)
    hint = f"; did you mean {close[0]!r}?" if close else "."
    return f"unknown key {name!r}{_inside(path)}{hint} Known keys: {', '.join(known)}"


def _missing_key(model: type[BaseModel], path: KeyPath) -> str:
    if isinstance(path[-1], int):
        return f"{dotted(path[:-1])} has {path[-1]} elements, too few{_meaning(model, path)}"
    field = _model_at(model, path[:-1]).model_fields.get(path[-1])
    if field is not None and _submodel(field) is not None:
        return f"the table [{dotted(path)}] is missing; add it"
    return f"the key {path[-1]!r} is missing{_inside(path)}; add it{_meaning(model, path)}"


def _allowed(details: ErrorDetails) -> str:
    if details["type"] == "value_error":
        return str(details["ctx"]["error"])
    if details["type"] == "literal_error":
        return f"allowed: {details['ctx']['expected']}{_closest(details)}"
    message = re.sub(r"^\w+ should", "it must", details["msg"])
    return _EXPECTED.get(details["type"], message)


def _closest(details: ErrorDetails) -> str:
    allowed = details["ctx"]["expected"].replace("'", "").replace(" or ", ", ").split(", ")
    close = get_close_matches(str(details["input"]), allowed, n=1)
    return f"; did you mean {close[0]!r}?" if close else ""


def _meaning(model: type[BaseModel], path: KeyPath) -> str:
    names = [part for part in path if isinstance(part, str)]
    field = _model_at(model, path[: path.index(names[-1])] if names else ()).model_fields.get(names[-1])
    return f" ({names[-1]}: {field.description})" if field is not None and field.description else ""


def _model_at(model: type[BaseModel], path: KeyPath) -> type[BaseModel]:
    """Return the model of the table at `path`; indices of lists lead nowhere else."""
    for name in path:
        field = model.model_fields.get(str(name))
        model = (_submodel(field) if field is not None else None) or model
    return model


def _submodel(field: FieldInfo) -> type[BaseModel] | None:
    for kind in (field.annotation, *get_args(field.annotation)):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
    return None


def dotted(path: KeyPath) -> str:
    """Return ``("boards", 1, "squares")`` as ``boards[1].squares``."""
    text = ""
    for part in path:
        text += f"[{part}]" if isinstance(part, int) else f".{part}" if text else part
    return text


def _inside(path: KeyPath) -> str:
    return f" in [{dotted(path[:-1])}]" if path[:-1] else ""


def _join(name: str, text: str) -> str:
    return f"{name}: {text}" if name else text


def _shown(value: Any) -> str:
    text = json.dumps(value, ensure_ascii=False, default=str)
    return text if len(text) <= 80 else f"{text[:77]}..."
