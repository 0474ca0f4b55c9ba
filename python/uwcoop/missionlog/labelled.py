"""Arrays with named dimensions that become an `xarray.Dataset` when somebody asks for one.

Importing xarray and what it needs takes longer than flying a small mission. What is simulated, replayed and scored inside
the package is kept in this form, which answers as a Dataset does where both are read the same way: `in`, `[name]` with
`values`, `dims` and `to_numpy()`, `attrs`, `data_vars`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, TypeAlias, Union

import numpy as np

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import NDArray

__all__ = ["Arrays", "DatasetWhenRead", "Labelled", "Variable"]


@dataclass(frozen=True)
class Variable:
    """An array and the names of its dimensions."""

    dims: tuple[str, ...]
    values: NDArray[Any]
    attrs: Mapping[str, Any] = field(default_factory=dict)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Of the array."""
        return self.values.dtype

    def to_numpy(self) -> NDArray[Any]:
        """The array itself."""
        return self.values

    def transpose(self, *dims: str) -> Variable:
        """With its dimensions in this order."""
        return Variable(dims, np.transpose(self.values, [self.dims.index(dim) for dim in dims]), self.attrs)


class Labelled:
    """Variables and coordinates by name, as `xarray.Dataset` takes them.

    Args:
        data_vars: (dims, array) or (dims, array, attributes) by name.
        coords: the same, or the values of a dimension of that name.
        attrs: of the whole.
    """

    def __init__(
        self, data_vars: Mapping[str, Any], coords: Mapping[str, Any], attrs: Mapping[str, Any] | None = None
    ) -> None:
        self.data_vars = {name: _variable(name, given) for name, given in data_vars.items()}
        self.coords = {name: _variable(name, given) for name, given in coords.items()}
        self.attrs = dict(attrs or {})

    @property
    def sizes(self) -> dict[str, int]:
        """Length of every dimension."""
        every = [*self.data_vars.values(), *self.coords.values()]
        return {dim: size for v in every for dim, size in zip(v.dims, v.values.shape, strict=True)}

    def __contains__(self, name: object) -> bool:
        return name in self.data_vars or name in self.coords

    def __getitem__(self, name: str) -> Variable:
        found = self.data_vars.get(name)
        return self.coords[name] if found is None else found

    def get(self, name: str) -> Variable | None:
        """A variable, or None where there is none of this name."""
        found = self.data_vars.get(name)
        return self.coords.get(name) if found is None else found

    def isel(self, **at: int) -> Labelled:
        """The part at one place of a dimension, which goes away: `isel(navigator=0)`."""
        ((dim, index),) = at.items()

        def part(variables: Mapping[str, Variable]) -> dict[str, Any]:
            return {
                name: (
                    tuple(d for d in v.dims if d != dim),
                    v.values.take(index, v.dims.index(dim)) if dim in v.dims else v.values,
                    v.attrs,
                )
                for name, v in variables.items()
            }

        return Labelled(part(self.data_vars), part(self.coords), self.attrs)

    def to_xarray(self) -> xr.Dataset:
        """The same as a Dataset; the arrays are shared."""
        import xarray as xr

        variables, coordinates = (
            {name: (v.dims, v.values, dict(v.attrs)) for name, v in group.items()}
            for group in (self.data_vars, self.coords)
        )
        return xr.Dataset(variables, coordinates, self.attrs)


Arrays: TypeAlias = Union[Labelled, "xr.Dataset"]
"""What can be read by name, whichever it is."""


class DatasetWhenRead:
    """An attribute that is an `xarray.Dataset` or None when it is read, and may be a `Labelled` until then."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name  # a data descriptor goes before the instance's own entry

    def __get__(self, instance: object | None, owner: type) -> xr.Dataset | None:
        held = None if instance is None else instance.__dict__[self._name]
        if isinstance(held, Labelled):
            held = instance.__dict__[self._name] = held.to_xarray()
        return held

    def __set__(self, instance: object, value: Arrays | None) -> None:
        instance.__dict__[self._name] = value


def _variable(name: str, given: Any) -> Variable:
    if isinstance(given, tuple):
        dims, values, *attributes = given
        dims = (dims,) if isinstance(dims, str) else tuple(dims)
        return Variable(dims, np.asarray(values), *attributes)
    return Variable((name,), np.asarray(given))
