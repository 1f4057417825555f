"""Make the mesh files of this folder anew: `pip install gmsh`, then `python make.py`. They were made with gmsh 4.15.

A rectangle 2 by 1 of triangles and of quadrilaterals, and a box 1 by 1 by 2 of tetrahedra and of hexahedra, each as
text and as bytes of both versions. Groups: `body`, and `bottom` and `top` at the ends of the last
coordinate.
The box in two parts, `low` and `high`, has the group `both` too.
"""

from pathlib import Path

import gmsh

FOLDER = Path(__file__).parent
SIZES = {2: (2.0, 1.0), 3: (1.0, 1.0, 2.0)}


def save(name):
    """Save the mesh as text and as bytes of both versions."""
    for version in (2.2, 4.1):
        for binary in (0, 1):
            gmsh.option.setNumber("Mesh.MshFileVersion", version)
            gmsh.option.setNumber("Mesh.Binary", binary)
            gmsh.write(str(FOLDER / f"{name}-{version}-{'bytes' if binary else 'text'}.msh"))


def ends(dim, height):
    """Make the groups of the two ends."""
    for _, tag in gmsh.model.getEntities(dim - 1):
        place = gmsh.model.occ.getCenterOfMass(dim - 1, tag)[dim - 1]
        for name, at in (("bottom", 0.0), ("top", height)):
            if abs(place - at) < 1e-6:
                gmsh.model.addPhysicalGroup(dim - 1, [tag], name=name)


def body(name, dim, structured):
    """Make a rectangle or a box, in rows of cells or not."""
    gmsh.clear()
    sizes, solid, mesh = SIZES[dim], gmsh.model.occ, gmsh.model.mesh
    tag = solid.addRectangle(0, 0, 0, *sizes) if dim == 2 else solid.addBox(0, 0, 0, *sizes)
    solid.synchronize()
    if structured:
        for _, curve in gmsh.model.getEntities(1):
            mesh.setTransfiniteCurve(curve, 3)
        for _, surface in gmsh.model.getEntities(2):
            mesh.setTransfiniteSurface(surface)
            mesh.setRecombine(2, surface)
        if dim == 3:
            mesh.setTransfiniteVolume(tag)
    ends(dim, sizes[-1])
    gmsh.model.addPhysicalGroup(dim, [tag], name="body")
    mesh.generate(dim)
    save(name)


def parts():
    """Make a box of two parts."""
    gmsh.clear()
    solid = gmsh.model.occ
    solid.fragment([(3, solid.addBox(0, 0, 0, 1, 1, 1))], [(3, solid.addBox(0, 0, 1, 1, 1, 1))])
    solid.synchronize()
    low, high = sorted((tag for _, tag in gmsh.model.getEntities(3)), key=lambda tag: solid.getCenterOfMass(3, tag)[2])
    ends(3, 2.0)
    for name, tags in {"low": [low], "high": [high], "both": [low, high]}.items():
        gmsh.model.addPhysicalGroup(3, tags, name=name)
    gmsh.model.mesh.generate(3)
    save("parts")


gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
gmsh.option.setNumber("Mesh.MeshSizeMin", 1)
gmsh.option.setNumber("Mesh.MeshSizeMax", 1)
for kind, dim, structured in (("triangle", 2, False), ("quad", 2, True), ("tetra", 3, False), ("hexahedron", 3, True)):
    body(kind, dim, structured)
parts()
gmsh.finalize()
