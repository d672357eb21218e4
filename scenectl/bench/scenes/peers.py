"""Tools that turn a mesh into a grid of signed distances, ours and others', each measured in a process of its own.

The process runs this file as a script, so that nothing is imported but what its tool needs. Every tool gets the same
triangles and the same nodes, around the middle of the cube, where single precision is at its best.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module, metadata, util
from pathlib import Path
from typing import Any

import numpy as np

from scenectl.bench.process import environment, python

CHUNK = 2**20
"""Nodes that are asked at once, of tools that answer points and keep what they built from the mesh."""


@dataclass(frozen=True, eq=False)
class Cube:
    """Triangles, and the nodes at which their signed distance is wanted.

    Attributes:
        vertices: ``[V, 3]`` float64, metres, relative to the middle of the cube.
        faces: ``[F, 3]`` int64.
        spacing: metres between nodes.
        nodes: along each axis; node ``[i, j, k]`` lies at ``spacing * ((i, j, k) - (nodes - 1) / 2)``.
    """

    vertices: np.ndarray
    faces: np.ndarray
    spacing: float
    nodes: int

    @property
    def axis(self) -> np.ndarray:
        """Coordinates of the nodes along each axis, ``[nodes]`` metres."""
        places: np.ndarray = self.spacing * (np.arange(self.nodes) - (self.nodes - 1) / 2)
        return places

    def points(self, dtype: type = np.float64, chunk: int | None = None) -> Iterator[np.ndarray]:
        """All nodes in the order of the grid, as arrays ``[n, 3]`` of whole slabs, about `chunk` (default: all)."""
        slabs = self.nodes if chunk is None else max(1, chunk // self.nodes**2)
        axis: np.ndarray = self.axis.astype(dtype)
        for first in range(0, self.nodes, slabs):
            x = axis[first : first + slabs]
            block: np.ndarray = np.empty((len(x), self.nodes, self.nodes, 3), dtype)
            block[..., 0], block[..., 1], block[..., 2] = x[:, None, None], axis[:, None], axis
            yield block.reshape(-1, 3)

    def asked(self, answer: Callable[[np.ndarray], Any], dtype: type = np.float32, chunk: int | None = CHUNK) -> Any:
        """The grid ``[nodes, nodes, nodes]`` of what `answer` says of points ``[n, 3]``."""
        values = np.empty(self.nodes**3, np.float32)
        start = 0
        for points in self.points(dtype, chunk):
            values[start : start + len(points)] = answer(points)
            start += len(points)
        return values.reshape((self.nodes,) * 3)


# ------------------------------------------------------------------------------------------------------------- tools


def _scenectl(cube: Cube) -> np.ndarray:
    from scenes.mesh.mesh import Mesh
    from scenes.sdf.bake import bake
    from scenes.sdf.lattice import Lattice

    corner = float(cube.axis[0])
    lattice = Lattice((corner, corner, corner), cube.spacing, (cube.nodes,) * 3)
    mesh = Mesh(cube.vertices, cube.faces, digest="not asked for")
    return bake(mesh, lattice=lattice, cache=None).grid.values.numpy()


def _open3d(cube: Cube) -> np.ndarray:
    import open3d as o3d

    scene = o3d.t.geometry.RaycastingScene()
    tensor = o3d.core.Tensor.from_numpy
    scene.add_triangles(tensor(cube.vertices.astype(np.float32)), tensor(cube.faces.astype(np.uint32)))
    return cube.asked(lambda points: scene.compute_signed_distance(tensor(points)).numpy())


def _mesh2sdf(cube: Cube) -> np.ndarray:
    import mesh2sdf

    # Its node i lies at -1 + 2 i / n, so that the last is not at 1.
    scale = 2 / (cube.nodes * cube.spacing)
    vertices = ((cube.vertices - cube.axis[0]) * scale - 1).astype(np.float32)
    return np.asarray(mesh2sdf.compute(vertices, cube.faces.astype(np.uint32), cube.nodes)) / np.float32(scale)


def _libigl(cube: Cube, sign: str) -> np.ndarray:
    import igl

    kind = getattr(igl.SignedDistanceType, f"SIGNED_DISTANCE_TYPE_{sign}")
    # Every call builds its trees anew, so there is one call.
    return cube.asked(
        lambda points: igl.signed_distance(points, cube.vertices, cube.faces, sign_type=kind)[0], np.float64, None
    )


def _libigl_fwn(cube: Cube) -> np.ndarray:
    return _libigl(cube, "FAST_WINDING_NUMBER")


def _libigl_pseudonormal(cube: Cube) -> np.ndarray:
    return _libigl(cube, "PSEUDONORMAL")


def _point_cloud_utils(cube: Cube) -> np.ndarray:
    import point_cloud_utils as pcu

    # Every call builds its trees anew, so there is one call.
    return cube.asked(
        lambda points: pcu.signed_distance_to_mesh(points, cube.vertices, cube.faces)[0], np.float64, None
    )


def _pysdf(cube: Cube) -> np.ndarray:
    import pysdf

    distance = pysdf.SDF(cube.vertices.astype(np.float32), cube.faces.astype(np.uint32))
    return cube.asked(lambda points: -distance(points))  # positive inside


def _warp(cube: Cube) -> np.ndarray:
    import warp as wp

    mesh = wp.Mesh(
        wp.array(cube.vertices.astype(np.float32), dtype=wp.vec3, device="cpu"),
        wp.array(cube.faces.astype(np.int32).reshape(-1), dtype=wp.int32, device="cpu"),
        support_winding_number=True,
    )
    query = _warp_query()

    def answer(points: np.ndarray) -> np.ndarray:
        given = wp.array(points, dtype=wp.vec3, device="cpu")
        found = wp.empty(len(points), dtype=wp.float32, device="cpu")
        wp.launch(query, len(points), [mesh.id, given, found], device="cpu")
        return np.asarray(found.numpy())

    return cube.asked(answer)


def _warp_query() -> Any:
    """The kernel that a user of warp would write; warp compiles it from this source and keeps the machine code."""
    import warp as wp

    def signed(mesh, points, found):  # type: ignore[no-untyped-def]
        i = wp.tid()
        point = points[i]
        query = wp.mesh_query_point_sign_winding_number(mesh, point, 1.0e6)
        nearest = wp.mesh_eval_position(mesh, query.face, query.u, query.v)
        found[i] = query.sign * wp.length(point - nearest)

    types = (wp.uint64, wp.array(dtype=wp.vec3), wp.array(dtype=wp.float32))
    signed.__annotations__ = dict(zip(("mesh", "points", "found"), types, strict=True))
    return wp.Kernel(signed, key="signed", module=wp.get_module("scenectl_peer"))


def _pytorch_volumetric(cube: Cube) -> np.ndarray:
    import open3d as o3d
    import pytorch_volumetric as pv
    import torch

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "mesh.ply"  # it reads files only
        triangles = o3d.utility.Vector3iVector(cube.faces.astype(np.int32))
        o3d.io.write_triangle_mesh(
            file, o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(cube.vertices), triangles)
        )
        distance = pv.MeshSDF(pv.MeshObjectFactory(str(file)))
    return cube.asked(lambda points: distance(torch.from_numpy(points))[0].numpy())


@dataclass(frozen=True)
class Tool:
    """Something that bakes a cube.

    Attributes:
        bake: signed distances ``[nodes, nodes, nodes]`` (m), positive outside, as the tool gives them.
        module: what it imports.
        distribution: the package that it comes in.
    """

    bake: Callable[[Cube], np.ndarray]
    module: str
    distribution: str

    @property
    def installed(self) -> bool:
        """Its module can be found; it is not imported."""
        return util.find_spec(self.module) is not None

    @property
    def version(self) -> str:
        """Version of its package."""
        return metadata.version(self.distribution)


OURS = "scenectl"
TOOLS = {
    OURS: Tool(_scenectl, "scenes", "scenectl"),
    "open3d": Tool(_open3d, "open3d", "open3d"),
    "mesh2sdf": Tool(_mesh2sdf, "mesh2sdf", "mesh2sdf"),
    "libigl_fwn": Tool(_libigl_fwn, "igl", "libigl"),
    "libigl_pseudonormal": Tool(_libigl_pseudonormal, "igl", "libigl"),
    "point_cloud_utils": Tool(_point_cloud_utils, "point_cloud_utils", "point-cloud-utils"),
    "pysdf": Tool(_pysdf, "pysdf", "pysdf"),
    "warp": Tool(_warp, "warp", "warp-lang"),
    "pytorch_volumetric": Tool(_pytorch_volumetric, "pytorch_volumetric", "pytorch-volumetric"),
}


# --------------------------------------------------------------------------------------------------------- processes


@dataclass(frozen=True)
class Run:
    """What one bake cost; None and a note where it failed or ran out of time.

    Attributes:
        cpu_s: processor seconds, of the user and the system, on all threads.
        wall_s: seconds.
        peak_mb: most memory that the process ever held, MiB.
        base_mb: memory before the bake, with libraries, the mesh and compiled code, MiB.
        note: what went wrong.
    """

    cpu_s: float | None = None
    wall_s: float | None = None
    peak_mb: float | None = None
    base_mb: float | None = None
    note: str = ""


def timed(tool: str, cube: Path, grid: Path, timeout: float | int) -> Run:
    """Bake the cube in the file `cube` with `tool` in a fresh process, which leaves the values in the file `grid`."""
    command = python(__file__, tool, str(cube), str(grid))  # this file's folder has modules whose names others use
    try:
        done = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=timeout)
    except subprocess.TimeoutExpired:
        return Run(note=f"over {timeout:g} s")
    if done.returncode != 0:
        said = (done.stderr.strip() or f"exit status {done.returncode}").splitlines()
        return Run(note=f"failed: {said[-1][:200]}")
    return Run(**json.loads(done.stdout.splitlines()[-1]))


def store(cube: Cube, path: Path) -> None:
    """Keep a cube for `timed`."""
    np.savez(path, vertices=cube.vertices, faces=cube.faces, spacing=cube.spacing, nodes=cube.nodes)


def _load(path: str) -> Cube:
    with np.load(path) as data:
        return Cube(data["vertices"], data["faces"], float(data["spacing"]), int(data["nodes"]))


def _tiny() -> list[Cube]:
    """A solid, a room and a soup: what is imported or compiled at first use comes with one of them."""
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]) - 0.25
    solid = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    rng = np.random.default_rng(0)
    soup = (rng.uniform(-1, 1, (100, 1, 3)) + rng.normal(size=(100, 3, 3))).reshape(-1, 3).clip(-1.2, 1.2)
    return [
        Cube(corners, solid, 0.25, 12),
        Cube(corners, solid[:, ::-1].copy(), 0.25, 12),
        Cube(soup, np.arange(len(soup)).reshape(-1, 3), 0.1, 26),
    ]


def _measure(bake: Callable[[Cube], np.ndarray], cube: Cube) -> tuple[np.ndarray, Run]:
    base = _memory_mb("VmRSS")
    cpu, wall = time.process_time(), time.perf_counter()
    values = bake(cube)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    return values, Run(cpu, wall, _memory_mb("VmHWM"), base)


def _memory_mb(which: str) -> float:
    """A figure of Linux's about this process; `ru_maxrss` would count the process that started it."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(f"{which}:")) / 1024


def main(tool: str, cube_file: str, grid_file: str) -> None:
    """Bake one cube, write its grid, and print what it cost as the last line."""
    bake = TOOLS[tool].bake
    import_module(TOOLS[tool].module)
    cube = _load(cube_file)
    for tiny in _tiny():
        bake(tiny)
    values, run = _measure(bake, cube)
    np.save(grid_file, np.asarray(values, np.float32))
    print("\n" + json.dumps(run.__dict__))


if __name__ == "__main__":
    main(*sys.argv[1:])
