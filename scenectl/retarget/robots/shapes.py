"""Where the shapes of a robot's bodies are."""

from __future__ import annotations

from collections.abc import Collection
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float

_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))


def corners(model: Any, data: Any, bodies: Collection[int]) -> Float[np.ndarray, "n 3"]:
    """Points (m, world) that bound the shapes of some bodies: corners of meshes, and of the boxes around all others.

    Shapes that collide, or all where none of the bodies' does.
    """
    geoms = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] in bodies]
    hard = [geom for geom in geoms if model.geom_contype[geom] or model.geom_conaffinity[geom]]
    points = [np.zeros((0, 3))]
    for geom in hard or geoms:
        mesh = model.geom_dataid[geom]
        if mesh >= 0:
            first = model.mesh_vertadr[mesh]
            local = model.mesh_vert[first : first + model.mesh_vertnum[mesh]].astype(float)
        else:
            local = model.geom_aabb[geom, :3] + _CORNERS * model.geom_aabb[geom, 3:]
        points.append(data.geom_xpos[geom] + local @ data.geom_xmat[geom].reshape(3, 3).T)
    return np.concatenate(points)
