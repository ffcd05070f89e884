"""Meshes of two tetrahedra, written by meshio into a directory.

The answer is an object: for each file, its tetrahedra as lists of points.
"""

import json
import sys
from pathlib import Path

import meshio
import numpy

POINTS = numpy.array([[0, 0, 0], [100, 0, 0], [0, 100, 0], [0, 0, 100], [100, 100, 100]], dtype=float)
TETRAHEDRA = [[0, 1, 2, 3], [1, 4, 2, 3]]
TRIANGLES = [[0, 2, 1]]
EDGES = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
# Names of the files, with their formats. Some formats have no quadratic elements of each kind.
FILES = {
    "abaqus.inp": ("abaqus", "both"),
    "vtu.vtu": ("vtu", "both"),
    "vtk.vtk": ("vtk", "both"),
    "netgen.vol": ("netgen", "both"),
    "ucd.inp": ("avsucd", "linear"),
    "fluent.msh": ("ansys", "linear"),
    "tetgen.node": ("tetgen", "linear"),
    "medit.mesh": ("medit", "linear"),
    "gmsh.msh": ("gmsh", "solid"),
}


def quadratic():
    points, places = list(map(tuple, POINTS)), {}

    def middle(one, other):
        key = (min(one, other), max(one, other))
        if key not in places:
            places[key] = len(points)
            points.append(tuple((POINTS[one] + POINTS[other]) / 2))
        return places[key]

    def refined(corners, edges):
        return [*corners, *(middle(corners[one], corners[other]) for one, other in edges)]

    tetrahedra = [refined(corners, EDGES) for corners in TETRAHEDRA]
    triangles = [refined(corners, EDGES[:3]) for corners in TRIANGLES]
    return numpy.array(points), triangles, tetrahedra


def solids(points, tetrahedra):
    return [[points[node].tolist() for node in nodes] for nodes in tetrahedra]


home = Path(sys.argv[1])
points, triangles, tetrahedra = quadratic()
linear = meshio.Mesh(POINTS, [("triangle", TRIANGLES), ("tetra", TETRAHEDRA)])
both = meshio.Mesh(points, [("triangle6", triangles), ("tetra10", tetrahedra)])
solid = meshio.Mesh(points, [("tetra10", tetrahedra)])
answers = {}
for name, (kind, elements) in FILES.items():
    if elements != "solid":
        linear.write(home / f"linear_{name}", file_format=kind)
        answers[f"linear_{name}"] = solids(POINTS, TETRAHEDRA)
    if elements != "linear":
        (solid if elements == "solid" else both).write(home / f"quadratic_{name}", file_format=kind)
        answers[f"quadratic_{name}"] = solids(points, tetrahedra)
Path(sys.argv[2]).write_text(json.dumps(answers))
