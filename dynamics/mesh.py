"""The command `python -m dynamics.mesh`: a sail's mesh as a file for ParaView, see `dynamics.sail.mesh`."""

import numpy as np

from beamrider.io.arguments import stage_arguments
from beamrider.io.files import finish, run_stage
from dynamics.membrane.output.flight_file import write_mesh
from dynamics.sail.mesh import sail_mesh
from dynamics.scene.schema import read_scene


def main() -> None:
    """Write the mesh of a scene's sail for ParaView."""
    arguments = stage_arguments("dynamics.mesh", main.__doc__, "VTKHDF file to write", tables=False)
    sail = read_scene(arguments.scene).sail
    mesh = sail_mesh(sail)
    # Of designs, which only tables know, that which the scene or the library names
    thickness = np.array([r.properties.thickness_m or np.nan for r in sail.regions])[mesh.sector]
    write_mesh(arguments.out, mesh, {"sector": mesh.sector, "thickness": thickness})
    finish(arguments.out, arguments.watch, f"{len(mesh.nodes)} nodes, {len(mesh.triangles)} triangles")


if __name__ == "__main__":
    run_stage(main)
