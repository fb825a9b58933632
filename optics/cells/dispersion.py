"""Refractive indices that change with the wavelength: rows, Sellmeier terms, files, built-in materials.

Files are those of refractiveindex.info (Polyanskiy, Scientific Data 11 (2024) 94): YAML records with formulas 1 to 9 or
tables, and CSV exports. Wavelengths in them are in µm, and those of a formula may not be left. Between the rows of
tables n and k follow monotone cubics (Fritsch & Carlson, SIAM J. Numer. Anal. 17 (1980) 238): kinks would show in
whatever follows the wavelength.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from beamrider.arrays import Floats
from beamrider.io.files import InputError, load_yaml
from beamrider.io.wording import brief

MATERIALS = Path(__file__).parents[1] / "materials"
#: Most bytes of a file of an index.
_MOST_BYTES = 5_000_000
_HEADS = {("wl", "n"): "n", ("wl", "k"): "k", ("wl", "n", "k"): "nk"}


@dataclass(frozen=True)
class Dispersion:
    """n and k over the wavelength in nm, with the range that they are known in and where they come from."""

    source: str
    first_nm: float
    last_nm: float
    n: Callable[[float], float]
    k: Callable[[float], float] | None

    @property
    def told(self) -> str:
        """Source and range in one line."""
        return f"{self.source}, {self.first_nm:g} … {self.last_nm:g} nm"

    def at(self, wavelength_nm: float) -> tuple[float, float]:
        """(n, k) at a wavelength in nm, k = 0 where the source knows none; ValueError outside its range."""
        if not self.first_nm <= wavelength_nm <= self.last_nm:
            raise ValueError(
                f"wavelength_nm = {wavelength_nm:g}: must be within {self.first_nm:g} … {self.last_nm:g}, what "
                f"{self.source} holds"
            )
        return self.n(wavelength_nm), 0.0 if self.k is None else self.k(wavelength_nm)


def of_rows(rows: Sequence[Sequence[float]], source: str) -> Dispersion:
    """From rows [wavelength in nm, n, k]; ValueError where they don't ascend."""
    columns = np.asarray(rows, float).T
    return _tabulated(source, columns[0], columns[1], columns[2])


def of_sellmeier(terms: Sequence[Sequence[float]], range_nm: Sequence[float], source: str) -> Dispersion:
    """From terms [B, λ₀ in µm] of n² = 1 + Σ B λ²/(λ² − λ₀²) (Sellmeier, Ann. Phys. 219 (1871) 272)."""
    first, last = map(float, range_nm)
    if not 0.0 < first < last < np.inf:
        raise ValueError(f"range_nm = [{first:g}, {last:g}]: must be two ascending wavelengths")
    return Dispersion(source, first, last, _formula(1, [0.0, *(number for term in terms for number in term)]), None)


def material(name: str) -> Dispersion:
    """A built-in material; ValueError lists them."""
    if name not in (known := materials()):
        raise ValueError(f"material = {brief(name)}: must be one of {', '.join(known)}")
    return _of_yaml(str(MATERIALS / f"{name}.yml"), name, 0)


def materials() -> list[str]:
    """Names of the built-in materials."""
    return sorted(path.stem for path in MATERIALS.glob("*.yml"))


def of_file(name: str) -> Dispersion:
    """From a YAML or CSV file of refractiveindex.info below the present folder; ValueError says what is wrong."""
    path = PurePosixPath(name)
    if path.is_absolute() or ".." in path.parts or path.suffix not in (".yml", ".yaml", ".csv"):
        raise ValueError(f"file = {brief(name)}: must be a path of a .yml, .yaml or .csv file below this folder")
    try:
        state = Path(name).stat()
    except OSError as error:
        raise ValueError(f"file = {name}: cannot be read ({error.strerror})") from None
    if state.st_size > _MOST_BYTES:
        raise ValueError(f"file = {name}: must have at most {_MOST_BYTES / 1e6:g} MB")
    try:
        return _of_csv(name) if path.suffix == ".csv" else _of_yaml(name, name, state.st_mtime_ns)
    except (InputError, OSError, UnicodeDecodeError) as error:
        raise ValueError(f"file = {name}: {str(error).removeprefix(f'{name}: ')}") from None


def _tabulated(source: str, wavelength: Floats, n: Floats, k: Floats | None) -> Dispersion:
    """Monotone cubics through the rows (m,), wavelengths in nm."""
    if wavelength.size < 2 or not (np.all(np.isfinite(wavelength)) and np.all(np.diff(wavelength) > 0)):
        raise ValueError(f"{source}: must have two or more rows of ascending wavelengths")
    if not (np.all(n > 0) and np.all(n < np.inf)) or (k is not None and not (np.all(k >= 0) and np.all(k < np.inf))):
        raise ValueError(f"{source}: n must be greater than 0, k at least 0, in every row")
    curves = [PchipInterpolator(wavelength, column) if column is not None else None for column in (n, k)]
    values = [None if curve is None else (lambda x, of=curve: float(of(x))) for curve in curves]
    return Dispersion(source, float(wavelength[0]), float(wavelength[-1]), values[0], values[1])  # type: ignore[arg-type]


def _formula(kind: int, c: Sequence[float]) -> Callable[[float], float]:
    """N over the wavelength in nm by a formula of the database, its coefficients for µm; ValueError if n is none."""

    def n(wavelength_nm: float) -> float:
        with np.errstate(all="ignore"):
            value = float(FORMULAS[kind](wavelength_nm / 1000.0, np.asarray(c, float)))
        if not 0.0 < value < np.inf:
            raise ValueError(f"formula {kind} gives n = {value:g} at wavelength_nm = {wavelength_nm:g}")
        return value

    return n


def _pairs(c: Floats, start: int = 1) -> tuple[Floats, Floats]:
    """Coefficients from `start` on, two and two (m,) each."""
    return c[start::2], c[start + 1 :: 2]


def _sellmeier(x: float, c: Floats) -> float:
    b, root = _pairs(c)
    return np.sqrt(1.0 + c[0] + np.sum(b * x**2 / (x**2 - root**2)))


def _sellmeier_2(x: float, c: Floats) -> float:
    b, square = _pairs(c)
    return np.sqrt(1.0 + c[0] + np.sum(b * x**2 / (x**2 - square)))


def _polynomial(x: float, c: Floats) -> float:
    factor, power = _pairs(c)
    return np.sqrt(c[0] + np.sum(factor * x**power))


def _mixed(x: float, c: Floats) -> float:
    c = np.concatenate([c, np.zeros(max(0, 9 - c.size))])
    factor, power = _pairs(c, 9)
    poles = sum(c[i] * x ** c[i + 1] / (x**2 - c[i + 2] ** c[i + 3]) for i in (1, 5) if c[i] != 0.0)
    return np.sqrt(c[0] + poles + np.sum(factor * x**power))


def _cauchy(x: float, c: Floats) -> float:
    factor, power = _pairs(c)
    return float(c[0] + np.sum(factor * x**power))


def _gas(x: float, c: Floats) -> float:
    factor, pole = _pairs(c)
    return float(1.0 + c[0] + np.sum(factor / (pole - x**-2)))


def _herzberger(x: float, c: Floats) -> float:
    near = 1.0 / (x**2 - 0.028)
    return float(np.sum(c * np.array([1.0, near, near**2, x**2, x**4, x**6])[: c.size]))


def _retro(x: float, c: Floats) -> float:
    value = c[0] + c[1] * x**2 / (x**2 - c[2]) + c[3] * x**2
    return np.sqrt((1.0 + 2.0 * value) / (1.0 - value))


def _exotic(x: float, c: Floats) -> float:
    return np.sqrt(c[0] + c[1] / (x**2 - c[2]) + c[3] * (x - c[4]) / ((x - c[4]) ** 2 + c[5]))


#: Formulas of the database by their numbers ("Dispersion formulas" there): n from λ in µm and coefficients.
FORMULAS: dict[int, Callable[[float, Floats], float]] = {
    1: _sellmeier,
    2: _sellmeier_2,
    3: _polynomial,
    4: _mixed,
    5: _cauchy,
    6: _gas,
    7: _herzberger,
    8: _retro,
    9: _exotic,
}
#: Fewest and most coefficients; formulas of pairs have an odd number.
_COUNTS = {1: (3, 31), 2: (3, 31), 3: (1, 31), 4: (5, 31), 5: (1, 31), 6: (3, 31), 7: (3, 6), 8: (4, 4), 9: (6, 6)}


def _numbers(given: Any, what: str) -> Floats:
    """Numbers in a text, or the one number that YAML made of it."""
    try:
        return np.array([float(word) for word in str(given).split()])
    except ValueError:
        raise ValueError(f"{what} = {brief(given)}: must be numbers") from None


@lru_cache(maxsize=64)
def _of_yaml(path: str, name: str, written: int) -> Dispersion:
    """A record of the database as it was `written` last: the first part that gives n, and the first that gives k."""
    data = load_yaml(path)
    parts = data.get("DATA") if isinstance(data, dict) else None
    if not (isinstance(parts, list) and parts and all(isinstance(part, dict) for part in parts)):
        raise ValueError(f"{name}: no record of refractiveindex.info: DATA must be a list of its parts")
    source = f"{name} ({_reference(data)})" if "REFERENCES" in data else name
    found: dict[str, Dispersion] = {}
    for part in parts:
        for quantity, dispersion in _part(part, source).items():
            found.setdefault(quantity, dispersion)
    if "n" not in found:
        raise ValueError(f"{name}: DATA: must give n")
    n, k = found["n"], found.get("k")
    if k is None:
        return n
    first, last = max(n.first_nm, k.first_nm), min(n.last_nm, k.last_nm)
    if not first < last:
        raise ValueError(f"{name}: DATA: n and k share no wavelengths")
    return Dispersion(source, first, last, n.n, k.k)


def _reference(data: dict[Any, Any]) -> str:
    """The first reference of a record in one short line, without the marks of web pages."""
    text = " ".join(re.sub(r"<[^>]*>", "", str(data["REFERENCES"])).split())
    return text if len(text) <= 200 else f"{text[:199]}…"


def _part(part: dict[Any, Any], source: str) -> dict[str, Dispersion]:
    """What a part of a record gives, by quantity: 'n', 'k'."""
    kind = str(part.get("type"))
    if kind.startswith("formula "):
        number = kind.removeprefix("formula ")
        if not number.isdigit() or int(number) not in FORMULAS:
            raise ValueError(f"{source}: type = {brief(kind)}: must be formula 1 … 9, or tabulated n, k or nk")
        c = _numbers(part.get("coefficients"), "coefficients")
        least, most = _COUNTS[int(number)]
        if not least <= c.size <= most or not np.all(np.isfinite(c)):
            raise ValueError(f"{source}: coefficients of formula {number}: must be {least} to {most} numbers")
        if int(number) not in (7, 8, 9) and c.size % 2 == 0:
            raise ValueError(f"{source}: coefficients of formula {number}: must be an odd number of numbers")
        limits = 1000.0 * _numbers(part.get("wavelength_range", part.get("range")), "wavelength_range")
        if limits.size != 2 or not 0 < limits[0] < limits[1] < np.inf:
            raise ValueError(f"{source}: wavelength_range: must be two ascending wavelengths in µm")
        return {"n": Dispersion(source, float(limits[0]), float(limits[1]), _formula(int(number), list(c)), None)}
    columns = {"tabulated nk": "nk", "tabulated n": "n", "tabulated k": "k"}.get(kind)
    if columns is None:
        raise ValueError(f"{source}: type = {brief(kind)}: must be formula 1 … 9, or tabulated n, k or nk")
    rows = [_numbers(line, "data") for line in str(part.get("data")).splitlines() if line.strip()]
    return _of_columns(rows, columns, source)


def _of_columns(rows: list[Floats], columns: str, source: str) -> dict[str, Dispersion]:
    """Rows of the wavelength in µm and, in the order of `columns`, n, k or both."""
    if not rows or any(row.size != 1 + len(columns) for row in rows):
        raise ValueError(f"{source}: data: must be rows of a wavelength in µm and {' and '.join(columns)}")
    table = np.array(rows)
    of = {name: table[:, 1 + i] for i, name in enumerate(columns)}
    # A part of k alone takes any n: only its own column is used.
    whole = _tabulated(source, 1000.0 * table[:, 0], of.get("n", np.ones(len(table))), of.get("k"))
    return dict.fromkeys(columns, whole)


def _of_csv(name: str) -> Dispersion:
    """A CSV export: a block `wl,n`, after which one `wl,k` may follow, or one block `wl,n,k`."""
    blocks: list[tuple[str, list[Floats]]] = []
    for line in Path(name).read_text(encoding="utf-8-sig").splitlines():
        words = tuple(word.strip().strip('"').lower() for word in line.split(","))
        if not any(words):
            continue
        if words in _HEADS:
            blocks.append((_HEADS[words], []))
        elif not blocks:
            raise ValueError(f"file = {name}: must begin with wl,n or wl,n,k (wavelengths in µm)")
        else:
            blocks[-1][1].append(_numbers(" ".join(words), f"file = {name}: row"))
    found: dict[str, Dispersion] = {}
    for columns, rows in blocks:
        found |= _of_columns(rows, columns, name)
    if "n" not in found:
        raise ValueError(f"file = {name}: must give n")
    n, k = found["n"], found.get("k")
    if k is None or k is n:
        return n
    return Dispersion(name, max(n.first_nm, k.first_nm), min(n.last_nm, k.last_nm), n.n, k.k)
