"""What a sail's surface is made of: metagratings, lamellar stacks, any profile, films, read strictly from YAML."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Field,
    SerializerFunctionWrapHandler,
    ValidationError,
    ValidationInfo,
    model_serializer,
    model_validator,
)

from beamrider.io.files import DIMENSIONLESS, InputError, Name, Pair, Strict, read_mapping, validate
from beamrider.io.wording import brief, describe
from optics.cells.cross_section import cross_section
from optics.cells.dispersion import Dispersion, material, of_file, of_rows, of_sellmeier

ElectricAxis = Literal["g", "r"]

# Wide enough for every cell, narrow enough for every number that follows to stay finite.
Refraction = Annotated[float, Field(gt=0, le=1e6, json_schema_extra=DIMENSIONLESS)]
Extinction = Annotated[float, Field(ge=0, le=1e6, json_schema_extra=DIMENSIONLESS)]
Length = Annotated[float, Field(gt=0, le=1e12)]
Thickness = Annotated[float, Field(ge=0, le=1e12)]
Wavelength = Annotated[float, Field(ge=1e-3, le=1e12)]
# Starts and widths are decimals: their sums may miss each other by this share of the period.
_ROUNDING = 1e-12


class Index(Strict):
    """Complex refractive index n + ik (time factor exp(−iωt): k > 0 absorbs)."""

    n: Refraction
    """Real part."""
    k: Extinction = 0.0
    """Imaginary part, the extinction."""
    source: Annotated[str, Field(max_length=400)] = ""
    """Where a dispersive index comes from, and its range; found where it is not given."""

    @model_serializer(mode="wrap")
    def _as_given(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        found: dict[str, Any] = handler(self)
        return found if self.source else {"n": found["n"], "k": found["k"]}

    @property
    def permittivity(self) -> complex:
        """Relative permittivity (n + ik)²."""
        return complex(self.n, self.k) ** 2


class _Dispersive(Strict):
    """A refractive index that changes with the wavelength; files may give it wherever they give an index."""

    k: Extinction | None = None
    """Imaginary part at all wavelengths, in place of what the source holds."""


class TableIndex(_Dispersive):
    """An index from rows, monotone cubics in between; the cell's wavelength must lie within."""

    table: Annotated[
        list[Annotated[tuple[Wavelength, Refraction, Extinction], Field(strict=False)]],  # YAML knows lists alone
        Field(min_length=2, json_schema_extra={"unit": "nm, 1, 1"}),
    ]
    """Rows [wavelength in nm, n, k] of ascending wavelengths."""


class SellmeierIndex(_Dispersive):
    """An index by n² = 1 + Σ B λ²/(λ² − λ₀²)."""

    sellmeier: Annotated[list[Pair], Field(min_length=1, max_length=15, json_schema_extra={"unit": "1, µm"})]
    """Terms [B, λ₀ in µm]."""
    range_nm: Pair
    """Wavelengths between which they hold."""


class FileIndex(_Dispersive):
    """An index from a file of refractiveindex.info: a YAML record, or a CSV export."""

    file: Annotated[str, Field(min_length=1, max_length=200)]
    """Its path, below the folder where the command runs."""


class MaterialIndex(_Dispersive):
    """The index of a built-in material, Si3N4, SiO2, Si or MoS2: see optics/materials."""

    material: Annotated[str, Field(min_length=1, max_length=40)]
    """Its name."""


_DISPERSIVE: dict[str, type[_Dispersive]] = {
    "table": TableIndex,
    "sellmeier": SellmeierIndex,
    "file": FileIndex,
    "material": MaterialIndex,
}
_ROWS = "table: must be two or more rows [wavelength_nm, n, k] with ascending wavelengths"


def _at_wavelength(given: Any, info: ValidationInfo) -> Any:
    """An index as it is; a dispersive one in a file (`read_cell`) at the cell's wavelength, or ValueError."""
    if info.context is None or not isinstance(given, dict):
        return given
    kinds = [key for key in _DISPERSIVE if key in given]
    if not kinds:
        return given
    if len(kinds) > 1:
        raise ValueError(f"{kinds[0]}, {kinds[1]}: must be one of them")
    try:
        model = _DISPERSIVE[kinds[0]].model_validate(given)
    except ValidationError as error:
        said = describe(error.errors(include_url=False), given, _DISPERSIVE[kinds[0]])
        raise ValueError(_ROWS if said.startswith("table") else said) from None
    wavelength = info.context["wavelength_nm"]
    if not isinstance(wavelength, int | float) or isinstance(wavelength, bool):
        raise ValueError(f"{kinds[0]}: needs wavelength_nm, a number")
    curve = _curve(model)
    try:
        n, k = curve.at(float(wavelength))
    except ValueError as refusal:
        raise ValueError(f"{kinds[0]}: {refusal}") from None
    return {"n": n, "k": k if model.k is None else model.k, "source": curve.told}


def _curve(model: _Dispersive) -> Dispersion:
    """The curve that a dispersive index names; ValueError says what is wrong with it."""
    if isinstance(model, TableIndex):
        try:
            return of_rows(model.table, "the table")
        except ValueError:
            raise ValueError(_ROWS) from None
    if isinstance(model, SellmeierIndex):
        return of_sellmeier(model.sellmeier, model.range_nm, "sellmeier")
    return of_file(model.file) if isinstance(model, FileIndex) else material(model.material)  # type: ignore[attr-defined]


GivenIndex = Annotated[
    Index,
    BeforeValidator(
        _at_wavelength, json_schema_input_type=Index | TableIndex | SellmeierIndex | FileIndex | MaterialIndex
    ),
]


class Surroundings(Strict):
    """Refractive indices of the half-spaces in front of (light side) and behind the cell.

    The one behind may absorb (back_k > 0); light that enters it then counts as absorbed.
    """

    front: Refraction = 1.0
    """Index in front, where the light comes from."""
    back: Refraction = 1.0
    """Real part of the index behind."""
    back_k: Extinction = 0.0
    """Imaginary part of the index behind."""


class _Periodic(Strict):
    """What gratings share."""

    name: Name
    """Name of the design, that of the file without its ending."""
    wavelength_nm: Wavelength
    """Wavelength of the light in vacuum."""
    electric_axis: ElectricAxis
    """Direction of the electric field at normal incidence: along the ridges, 'r' (TE), or across them, 'g' (TM)."""
    period_nm: Length
    """Period along g."""

    @property
    def pitch(self) -> float:
        """λ/d, the step in u between diffraction orders."""
        return self.wavelength_nm / self.period_nm


class Metagrating(_Periodic):
    """Ridges of one height on a membrane, periodic along g and endless along r. Light falls on the ridges.

    Ridges must not overlap and must end within the period.
    """

    kind: Literal["metagrating"]
    """What the cell is."""
    ridges_nm: Annotated[list[Pair], Field(min_length=1)]
    """[start, width] of each ridge along +g within one period."""
    ridge_height_nm: Length
    """Height of the ridges above the membrane."""
    membrane_nm: Thickness
    """Thickness of the membrane below them."""
    index: GivenIndex
    """Refractive index of ridges and membrane."""
    surroundings: Surroundings = Surroundings()
    """What lies in front of the cell and behind it."""
    corner_radius_nm: Thickness = 0.0
    """Radius of the two outer corners of each ridge, those that the light reaches first; those at its foot stay sharp.

    At most the height of the ridges and half their width.
    """
    membrane_coherent: bool = True
    """False averages the fringes of the membrane, as for one that is uneven by wavelengths."""

    @model_validator(mode="after")
    def _ridges_fit(self) -> Metagrating:
        end, near = 0.0, _ROUNDING * self.period_nm
        for i, (start, width) in enumerate(self.ridges_nm):
            if width <= 0:
                raise ValueError(f"ridges_nm[{i}] = [{start:g}, {width:g}]: the width must be greater than 0")
            if start < end - near:
                what = "overlaps the ridge before it" if i else "starts left of the cell"
                raise ValueError(f"ridges_nm[{i}] = [{start:g}, {width:g}] {what}: its start must be at least {end:g}")
            end = start + width
        if end > self.period_nm + near:
            raise ValueError(f"ridges_nm: the last ridge ends at {end:g}, beyond period_nm = {self.period_nm:g}")
        return self

    @model_validator(mode="after")
    def _corners_fit(self) -> Metagrating:
        most = min([self.ridge_height_nm, *(width / 2 for _, width in self.ridges_nm)])
        if self.corner_radius_nm > most:
            raise ValueError(
                f"corner_radius_nm = {self.corner_radius_nm:g}: must be at most {most:g}, the height of the ridges and "
                "half their width"
            )
        if not self.membrane_coherent:
            _check_averaged("membrane_coherent", self.membrane_nm, self.index, self.wavelength_nm)
        if self.corner_radius_nm > 0 and not self.membrane_coherent:
            raise ValueError(
                f"membrane_coherent = false with corner_radius_nm = {self.corner_radius_nm:g}: must be true; or give "
                "the cell as kind: lamellar, with layers in place of the corners"
            )
        return self

    @property
    def fill(self) -> float:
        """Share of the period that ridges cover."""
        return sum(width for _, width in self.ridges_nm) / self.period_nm

    @property
    def mean_thickness_nm(self) -> float:
        """Thickness of the plain film of equal mass, in nm."""
        return 1e9 * cross_section(self.model_dump()).mean_m


def _check_averaged(where: str, thickness_nm: float, index: Index, wavelength_nm: float) -> None:
    """ValueError for a layer too thin to have fringes that could be averaged."""
    if thickness_nm * index.n < wavelength_nm / 2:
        raise ValueError(
            f"{where} = false with a thickness of {thickness_nm:g} nm: must be true below "
            f"{wavelength_nm / index.n / 2:g}, half a wavelength within"
        )


class Layer(Strict):
    """One homogeneous layer of a film, listed from the light side."""

    thickness_nm: Thickness
    """Thickness."""
    index: GivenIndex
    """Refractive index."""
    coherent: bool = True
    """False averages its fringes, as for a layer that is uneven, or light less coherent, by a wavelength."""


class ThinFilm(Strict):
    """A stack of homogeneous layers."""

    kind: Literal["thin_film"]
    """What the cell is."""
    name: Name
    """Name of the design, that of the file without its ending."""
    wavelength_nm: Wavelength
    """Wavelength of the light in vacuum."""
    polarisation: Literal["s", "p", "mean"] = "mean"
    """Polarisation of the light; 'mean' averages s and p (unpolarised light)."""
    layers: Annotated[list[Layer], Field(min_length=1)]
    """Layers from the light side on."""
    surroundings: Surroundings = Surroundings()
    """What lies in front of the film and behind it."""

    @model_validator(mode="after")
    def _averaged_are_thick(self) -> ThinFilm:
        for i, layer in enumerate(self.layers):
            if not layer.coherent:
                _check_averaged(f"layers[{i}].coherent", layer.thickness_nm, layer.index, self.wavelength_nm)
        return self


class Ridge(Strict):
    """A ridge within a lamellar layer: where it starts along +g, its width, and what it is made of."""

    start_nm: Thickness
    """Where it starts along +g."""
    width_nm: Length
    """Its width."""
    index: GivenIndex
    """Its refractive index."""


class LamellarLayer(Strict):
    """A layer whose index changes along g only: `index` with ridges in it that don't overlap."""

    thickness_nm: Thickness
    """Thickness."""
    index: GivenIndex
    """Refractive index beside the ridges."""
    ridges: list[Ridge] = []
    """Ridges, along +g."""
    coherent: bool = True
    """False averages the fringes of a layer without ridges, as for one that is uneven by wavelengths."""


class LamellarStack(_Periodic):
    """Any stack of lamellar layers with a common period."""

    kind: Literal["lamellar"]
    """What the cell is."""
    layers: Annotated[list[LamellarLayer], Field(min_length=1)]
    """Layers from the light side on."""
    surroundings: Surroundings = Surroundings()
    """What lies in front of the cell and behind it."""

    @model_validator(mode="after")
    def _ridges_fit(self) -> LamellarStack:
        near = _ROUNDING * self.period_nm
        for i, layer in enumerate(self.layers):
            end = 0.0
            if layer.ridges and not layer.coherent:
                raise ValueError(f"layers[{i}].coherent = false: must be true for a layer with ridges")
            if not layer.coherent:
                _check_averaged(f"layers[{i}].coherent", layer.thickness_nm, layer.index, self.wavelength_nm)
            for j, ridge in enumerate(layer.ridges):
                where = f"layers[{i}].ridges[{j}]"
                if ridge.start_nm < end - near:
                    raise ValueError(f"{where}.start_nm = {ridge.start_nm:g}: must be at least {end:g}")
                end = ridge.start_nm + ridge.width_nm
                if end > self.period_nm + near:
                    raise ValueError(f"{where} ends at {end:g}, beyond period_nm = {self.period_nm:g}")
        return self


def as_stack(cell: Metagrating | LamellarStack) -> LamellarStack:
    """The cell as a stack of lamellar layers. InputError for rounded corners: see `optics.cells.outline.staircase`."""
    if isinstance(cell, LamellarStack):
        return cell
    if cell.corner_radius_nm > 0:
        raise InputError(f"{cell.name}: corner_radius_nm = {cell.corner_radius_nm:g}: must be 0 for a lamellar layer")
    ridges = [Ridge(start_nm=start, width_nm=width, index=cell.index) for start, width in cell.ridges_nm]
    front = Index(n=cell.surroundings.front)
    return LamellarStack(
        kind="lamellar",
        name=cell.name,
        wavelength_nm=cell.wavelength_nm,
        electric_axis=cell.electric_axis,
        period_nm=cell.period_nm,
        surroundings=cell.surroundings,
        layers=[
            LamellarLayer(thickness_nm=cell.ridge_height_nm, index=front, ridges=ridges),
            LamellarLayer(thickness_nm=cell.membrane_nm, index=cell.index, coherent=cell.membrane_coherent),
        ],
    )


class Polygon(Strict):
    """A polygon of one material."""

    index: GivenIndex
    """Refractive index within."""
    vertices_nm: Annotated[list[Pair], Field(min_length=3)]
    """Vertices [g, n], either way round."""


class Profile(_Periodic):
    """Any cross-section: polygons in 0 … period along g and 0 … depth along n, later ones over earlier ones.

    n = 0 is the plane that the light reaches first; what no polygon covers has the index in front. A polygon across
    the edge of the period is given in two parts.
    """

    kind: Literal["profile"]
    """What the cell is."""
    depth_nm: Length
    """Depth along n, from the plane that the light reaches first to the last."""
    polygons: Annotated[list[Polygon], Field(min_length=1)]
    """Pieces of the cross-section, later ones over earlier ones."""
    surroundings: Surroundings = Surroundings()
    """What lies in front of the cell and behind it."""

    @model_validator(mode="after")
    def _polygons_fit(self) -> Profile:
        for i, polygon in enumerate(self.polygons):
            for j, (g, n) in enumerate(polygon.vertices_nm):
                if not (0 <= g <= self.period_nm and 0 <= n <= self.depth_nm):
                    raise ValueError(
                        f"polygons[{i}].vertices_nm[{j}] = [{g:g}, {n:g}]: must lie within 0 … {self.period_nm:g} by "
                        f"0 … {self.depth_nm:g}"
                    )
        return self


Cell = Metagrating | ThinFilm | LamellarStack | Profile


def is_coherent(cell: Cell) -> bool:
    """Are all layers of the cell coherent."""
    if isinstance(cell, Metagrating):
        return cell.membrane_coherent
    return isinstance(cell, Profile) or all(layer.coherent for layer in cell.layers)


def require_coherent(cell: Cell, solver: str) -> None:
    """InputError where a layer's fringes are averaged, for solvers that know fields alone."""
    if not is_coherent(cell):
        field = "membrane_coherent" if isinstance(cell, Metagrating) else "coherent"
        raise InputError(f"{cell.name}: {field} = false: must be true for {solver}; optics.modal averages fringes")


KINDS: dict[str, type[Cell]] = {
    "metagrating": Metagrating,
    "thin_film": ThinFilm,
    "lamellar": LamellarStack,
    "profile": Profile,
}


def read_cell(path: str | Path, wavelength_nm: float | None = None) -> Cell:
    """The cell described by a YAML file; InputError names the file, the field and what is allowed.

    `wavelength_nm` replaces the file's own wavelength, as for a sail that moves away from its laser. An index may be
    dispersive: rows, Sellmeier terms, a file, or a built-in material (see `optics.cells.dispersion`).
    """
    data = read_mapping(path)
    kind = data.get("kind")
    if not isinstance(kind, str) or kind not in KINDS:
        given = f"kind = {brief(kind)}: must be" if "kind" in data else "missing kind,"
        raise InputError(f"{path}: {given} one of {', '.join(KINDS)}")
    if wavelength_nm is not None:
        data["wavelength_nm"] = wavelength_nm
    return validate(data, KINDS[kind], path, {"wavelength_nm": data.get("wavelength_nm")})


def read_metagrating(path: str | Path) -> Metagrating:
    """Like `read_cell`, for stages that take gratings only."""
    cell = read_cell(path)
    if not isinstance(cell, Metagrating):
        raise InputError(f"{path}: kind = {cell.kind!r}: must be metagrating; use optics.thin_film for films")
    return cell
