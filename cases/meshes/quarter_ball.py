"""Make `quarter-ball.msh` anew: `pip install gmsh`, then `python quarter_ball.py`. With gmsh 4.15 it is the same bytes.

A quarter of a ball of radius 1 that stands on the origin. Cells of 0.04 within 0.25 of the lowest point, of up to 0.16
beyond. The two cuts are the groups `left` (x = 0) and `front` (y = 0), the round surface is `skin`.
"""

from pathlib import Path

import gmsh

gmsh.initialize()
gmsh.option.setNumber("General.Terminal", 0)
solid, mesh = gmsh.model.occ, gmsh.model.mesh
ball, box = solid.addSphere(0, 0, 1, 1), solid.addBox(0, 0, -1, 2, 2, 4)
solid.intersect([(3, ball)], [(3, box)])
solid.synchronize()
solid.addPoint(0, 0, 0)  # in no group, so gmsh leaves it out of the file; it changes the numbers of the nodes
solid.synchronize()
size = {"VIn": 0.04, "VOut": 0.16, "Radius": 0.25, "Thickness": 1.2, "XCenter": 0, "YCenter": 0, "ZCenter": 0}
mesh.field.add("Ball", 1)
for name, value in size.items():
    mesh.field.setNumber(1, name, value)
mesh.field.setAsBackgroundMesh(1)
for name in ("FromPoints", "FromCurvature", "ExtendFromBoundary"):
    gmsh.option.setNumber(f"Mesh.MeshSize{name}", 0)
groups = {}
for _, tag in gmsh.model.getEntities(2):
    x, y, _ = solid.getCenterOfMass(2, tag)
    groups.setdefault("left" if abs(x) < 1e-6 else "front" if abs(y) < 1e-6 else "skin", []).append(tag)
for name, tags in groups.items():
    gmsh.model.addPhysicalGroup(2, tags, name=name)
gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="ball")
mesh.generate(3)
mesh.optimize("Netgen")
gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
gmsh.option.setNumber("Mesh.Binary", 1)
gmsh.write(str(Path(__file__).with_name("quarter-ball.msh")))
gmsh.finalize()
