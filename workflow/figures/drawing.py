"""What the figures share: a colour-blind-safe look, NAME=FILE arguments, PNG and SVG side by side."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import h5py
import matplotlib as mpl
import numpy as np  # noqa: F401 - for the figures

from beamrider.arrays import Floats

mpl.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from beamrider.io.files import Stopwatch, atomic, finish, reading
from beamrider.io.hdf5 import read_hdf5
from beamrider.provenance.record import NAME, as_attribute

WATCH = Stopwatch()

# Okabe & Ito's colours, told apart with every kind of colour vision.
BLUE, ORANGE, GREEN, PURPLE, SKY, RED = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00"
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, RED, "black")

plt.rcParams.update(
    {
        "font.size": 9,
        "axes.titlesize": 9,
        "axes.grid": True,
        "grid.alpha": 0.3,
        "legend.fontsize": 8,
        "figure.dpi": 150,
        "figure.constrained_layout.use": True,
        "svg.fonttype": "none",
        "svg.hashsalt": "beamrider",
    }
)


def named(text: str) -> tuple[str, Path]:
    """'NAME=FILE' as (name, path)."""
    name, separator, path = text.partition("=")
    if not separator or not name or not path:
        raise argparse.ArgumentTypeError(f"'{text}': must be NAME=FILE")
    return name, Path(path)


def parser(description: str | None) -> argparse.ArgumentParser:
    """An argument parser with the two files that every figure writes."""
    result = argparse.ArgumentParser(description=description)
    result.add_argument("--out", required=True, type=Path, help="PNG to write")
    result.add_argument("--svg", required=True, type=Path, help="SVG to write")
    return result


def save(figure: Figure, png: Path, svg: Path) -> None:
    """Write both files, atomically; the SVG carries no date, so equal figures are equal files."""
    made = {"Description": made_from[NAME]} if (made_from := as_attribute()) else {}
    with atomic(png) as temporary:
        figure.savefig(temporary, format="png", dpi=200, metadata=made)
    with atomic(svg) as temporary:
        figure.savefig(temporary, format="svg", metadata={"Date": None} | made)
    plt.close(figure)
    finish(png, WATCH, "drawn, as SVG beside it")


def solver(floquet: dict[str, Any]) -> str:
    """The solver of the tables behind a stability analysis, from its own record; films' only where they are alone."""
    used = list(dict.fromkeys(table["solver"] for table in floquet["tables"].values()))
    gratings = [name for name in used if name != "thin_film"] or used
    return " and ".join({"fdtd": "FDTD", "thin_film": "thin-film"}.get(name, name) for name in gratings) or "no"


def read_series(path: Path) -> dict[str, Floats]:
    """Datasets of a rigid flight, or of the group /series of a flexible one; InputError where there is no such file."""
    with reading(path, "a readable flight"), read_hdf5(path) as file:
        group = file.get("series", file)
        return {name: item[()] for name, item in group.items() if isinstance(item, h5py.Dataset)}
