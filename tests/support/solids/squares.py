"""A block of squares, its element, and a pairing that cuts edges where nodes of either side lie: a plug-in of tests."""

from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

import numpy as np

from percuss import CellElement, Doc, Mesh, PairedPoints, Pairing, Region, Shape, Unit, Wall, stress

GAUSS = 1.0 / np.sqrt(3.0)


@dataclass(frozen=True)
class Block(Shape):
    """A rectangle along x and y from its lower left corner."""

    name = "squares"
    summary = "A rectangle of squares"
    regions = ("left", "right", "bottom", "top")
    cell = "quad"
    examples = ({"size": [1.0, 0.5], "elements": [4, 2]},)

    size: Annotated[tuple[float, float], Unit("length"), Doc("width and height")]
    elements: Annotated[tuple[int, int], Doc("elements across and up")]

    def dimension(self):
        return 2

    def mesh(self, at, refine):
        nx, ny = (self.refined(count, refine) for count in self.elements)
        x, y = self.size[0] * np.arange(nx + 1) / nx, self.size[1] * np.arange(ny + 1) / ny
        nodes = at + np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        corner = np.arange(nx)[:, None] * (ny + 1) + np.arange(ny)
        cells = np.stack([corner, corner + ny + 1, corner + ny + 2, corner + 1], axis=-1).reshape(-1, 4)
        number = np.arange((nx + 1) * (ny + 1)).reshape(nx + 1, ny + 1)
        runs = {"left": number[0, ::-1], "right": number[-1], "bottom": number[:, 0], "top": number[::-1, -1]}
        out = {"left": [-1.0, 0.0], "right": [1.0, 0.0], "bottom": [0.0, -1.0], "top": [0.0, 1.0]}
        regions = {
            name: Region(tuple(run.tolist()), np.array(out[name]), {"line": np.stack([run[:-1], run[1:]], axis=1)})
            for name, run in runs.items()
        }
        return Mesh(nodes, {"quad": cells}, regions)


class Rule(NamedTuple):
    xi: np.ndarray  # (points, 2)
    corners: np.ndarray  # (4, 2)


@dataclass(frozen=True)
class Square(CellElement):
    """A bilinear quadrilateral without lateral contraction: each strain has a stress of its own.

    Formula: a quadrature point asks the material three times: for both direct strains, and for the shear, whose stress
    is half of the modulus times the shear strain.
    """

    name = "square"
    summary = "Bilinear quadrilateral without lateral contraction"
    linear = True
    cell = "quad"
    references = ("Hughes: The Finite Element Method, Dover 2000, ch. 3",)

    def rule(self):
        corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        return Rule(GAUSS * corners, corners)

    def mass_shares(self, body):
        return np.full(4, 0.25)

    def volumes(self, body):
        across, up = self.sides(body)
        area = across[:, 0] * up[:, 1] - across[:, 1] * up[:, 0]
        return body.section * area[:, None] / 4 * np.tile([1.0, 1.0, 0.5], 4)

    def volumes_of_cells(self, body):
        return self.volumes(body)[:, ::3].sum(axis=1)

    def sides(self, body):
        corners = body.mesh.nodes[body.mesh.cells["quad"]]
        return corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0]

    def highest_frequency(self, body, wave_speed):
        """A rectangle alone: each of its modes stretches it one way."""
        across, up = self.sides(body)
        return 2.0 * wave_speed / np.minimum(np.linalg.norm(across, axis=1), np.linalg.norm(up, axis=1))

    @staticmethod
    def force(rule, material, first, section, coordinates, displacement, force):
        for a in range(4):
            force[a, 0] = 0.0
            force[a, 1] = 0.0
        for q in range(4):
            xx = xy = yx = yy = 0.0
            for a in range(4):
                by_xi = 0.25 * rule.corners[a, 0] * (1.0 + rule.xi[q, 1] * rule.corners[a, 1])
                by_eta = 0.25 * rule.corners[a, 1] * (1.0 + rule.xi[q, 0] * rule.corners[a, 0])
                xx += by_xi * coordinates[a, 0]
                xy += by_xi * coordinates[a, 1]
                yx += by_eta * coordinates[a, 0]
                yy += by_eta * coordinates[a, 1]
            determinant = xx * yy - xy * yx
            direct_x = direct_y = shear = 0.0
            for a in range(4):
                by_xi = 0.25 * rule.corners[a, 0] * (1.0 + rule.xi[q, 1] * rule.corners[a, 1])
                by_eta = 0.25 * rule.corners[a, 1] * (1.0 + rule.xi[q, 0] * rule.corners[a, 0])
                by_x = (yy * by_xi - xy * by_eta) / determinant
                by_y = (xx * by_eta - yx * by_xi) / determinant
                direct_x += by_x * displacement[a, 0]
                direct_y += by_y * displacement[a, 1]
                shear += by_y * displacement[a, 0] + by_x * displacement[a, 1]
            stress_x = stress(material, first + 3 * q, direct_x)
            stress_y = stress(material, first + 3 * q + 1, direct_y)
            stress_xy = 0.5 * stress(material, first + 3 * q + 2, shear)
            for a in range(4):
                by_xi = 0.25 * rule.corners[a, 0] * (1.0 + rule.xi[q, 1] * rule.corners[a, 1])
                by_eta = 0.25 * rule.corners[a, 1] * (1.0 + rule.xi[q, 0] * rule.corners[a, 0])
                by_x = (yy * by_xi - xy * by_eta) / determinant
                by_y = (xx * by_eta - yx * by_xi) / determinant
                force[a, 0] -= section * determinant * (by_x * stress_x + by_y * stress_xy)
                force[a, 1] -= section * determinant * (by_y * stress_y + by_x * stress_xy)


@dataclass(frozen=True)
class Straight(Pairing):
    """Points of two straight surfaces that face each other: at nodes, or by Gauss' rule between some cuts."""

    name = "straight"
    summary = "Points between straight surfaces"
    examples = ({}, {"points_at": "gauss"}, {"points_at": "cut"})
    references = ("none",)

    points_at: Annotated[Literal["nodes", "gauss", "cut"], Doc("nodes, gauss or cut")] = "nodes"

    def points(self, first, second):
        along = first.positions[:, int(np.abs(first.normals[0, 0]) > 0.5)]
        order = np.argsort(along)
        places = along[order]
        cuts = places
        if self.points_at == "cut" and not isinstance(second, Wall):
            other = np.sort(second.positions[:, int(np.abs(first.normals[0, 0]) > 0.5)])
            cuts = np.unique(np.round(np.concatenate([places, other]), 12))
        if self.points_at == "nodes":
            where, weight = places, np.convolve(np.diff(places), [0.5, 0.5])
        else:
            middle, half = 0.5 * (cuts[1:] + cuts[:-1]), 0.5 * np.diff(cuts)
            where = np.stack([middle - GAUSS * half, middle + GAUSS * half], axis=1).ravel()
            weight = np.repeat(half, 2)
        area = first.areas.sum() / np.ptp(places)
        normal, entries, gaps = first.normals[0], [], []
        for place in where:
            here = hat(place, places, first.nodes[order])
            entries.append([(node, -share * normal) for node, share in here])
            at = first.positions[0] * np.abs(normal)
            if isinstance(second, Wall):
                gaps.append(float(normal @ (second.point - at)))
                continue
            other = second.positions[:, int(np.abs(normal[0]) > 0.5)]
            turn = np.argsort(other)
            entries[-1] += [(node, share * normal) for node, share in hat(place, other[turn], second.nodes[turn])]
            gaps.append(float(normal @ (second.positions[0] - at)))
        count = np.zeros((len(where), 2), dtype=int)
        return PairedPoints(
            np.array(gaps), weight * area, np.tile(normal, (len(where), 1)), count,
            np.cumsum([0, *map(len, entries)]), np.array([node for row in entries for node, _ in row]),
            np.array([value for row in entries for _, value in row]),
        )  # fmt: skip


def hat(place, places, nodes):
    """The linear shape functions of a row of nodes at a place."""
    cell = min(max(int(np.searchsorted(places, place, side="right")) - 1, 0), len(places) - 2)
    upper = (place - places[cell]) / (places[cell + 1] - places[cell])
    both = ((int(nodes[cell]), float(1.0 - upper)), (int(nodes[cell + 1]), float(upper)))
    return [(node, share) for node, share in both if share > 1e-14]
