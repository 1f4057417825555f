"""Interface of a pairing: which points of two surfaces meet, and by which nodes the gap of each moves."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator
from functools import reduce
from typing import ClassVar, NamedTuple

import numpy as np

from percuss.methods.interfaces.base import Component, Floats, Integers
from percuss.methods.interfaces.cells import REFERENCE_CELLS
from percuss.methods.interfaces.nearest import nearest_places


class Surface(NamedTuple):
    """The surface of a body in contact as it is at the start.

    Attributes
    ----------
    nodes : (n,) array
        Numbers of its nodes in the model.
    positions : (n, dim) array
        Positions of these nodes [length].
    facets : (F, nodes of a facet) array
        Nodes of each facet, as indices into `nodes`. In two dimensions a facet is an edge, and edges run with the body
        on their left; in three its nodes run counter-clockwise as seen from outside.
    normals : (F, dim) array
        Unit vector out of the body at the middle of each facet.
    areas : (F,) array
        Area of each facet, in two dimensions length times thickness [length^2].
    around : (n,) array
        Of a body of revolution the length of the circle on which each node lies; None of any other [length].
    """

    nodes: Integers
    positions: Floats
    facets: Integers
    normals: Floats
    areas: Floats
    around: Floats | None = None

    def outward(self, facets: Integers, shares: Floats) -> Floats:
        """Return vectors out of the body at points of facets, (P, dim), as long as an edge or as a facet is large.

        A quadrilateral need not be plane: its vector differs from point to point, and the mean over its points is that
        of its middle.

        Parameters
        ----------
        facets : (P,) array
            Facet on which each point lies.
        shares : (P, nodes of a facet) array
            Shape functions of that facet at the point.
        """
        corners = self.positions[self.facets[facets]]
        along = corners[:, 1] - corners[:, 0]
        if corners.shape[2] == 2:
            return np.stack([along[:, 1], -along[:, 0]], axis=1)
        if corners.shape[1] == 3:
            return 0.5 * np.cross(along, corners[:, 2] - corners[:, 0])
        x, y = (shares @ REFERENCE_CELLS["quad"].corners).T[:, :, None]
        first = (1.0 - y) * along + (1.0 + y) * (corners[:, 2] - corners[:, 3])
        second = (1.0 - x) * (corners[:, 3] - corners[:, 0]) + (1.0 + x) * (corners[:, 2] - corners[:, 1])
        return 0.25 * np.cross(first, second)

    def nearest(self, at: Floats) -> tuple[Integers, Floats]:
        """Return the facet nearest to each point, (P,), and its shape functions at the nearest place of it.

        Parameters
        ----------
        at : (P, dim) array
            The points.

        Returns
        -------
        (P,) and (P, nodes of a facet) arrays
        """
        return nearest_places(at, self.positions[self.facets])

    def facets_at(self, ends: Iterable[Integers]) -> Iterator[Integers]:
        """Yield, for each of some sets of nodes, the facets that have all nodes of the set.

        Parameters
        ----------
        ends
            Nodes as indices into `nodes`, one array a set.
        """
        order = np.argsort(self.facets, axis=None, kind="stable")
        start = np.searchsorted(self.facets.ravel()[order], np.arange(len(self.nodes) + 1))
        for nodes in ends:
            yield reduce(np.intersect1d, [order[start[k] : start[k + 1]] // self.facets.shape[1] for k in nodes])

    def rims(self) -> tuple[Integers, Integers]:
        """Return where the edge from a node to the next one, and the node, are on the rim of an open surface, (F, w).

        Both are 1 there and else 0, w the number of nodes of a facet. In two dimensions no edge is: its ends may be.
        """
        facets = self.facets
        if facets.shape[1] == 2:
            return np.zeros_like(facets), (np.bincount(facets.ravel())[facets] == 1).astype(np.int64)
        edges = np.sort(np.stack([facets, np.roll(facets, -1, axis=1)], axis=2), axis=2)
        _, number, counts = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True)
        rim = (counts[number.ravel()] == 1).reshape(facets.shape)
        on_rim = np.zeros(len(self.nodes), dtype=np.int64)
        on_rim[edges[rim].ravel()] = 1
        return rim.astype(np.int64), on_rim[facets]

    def spread(self, facets: Integers, shares: Floats) -> Floats:
        """Return what area points stand for that see a whole facet each, (P,): of a body of revolution that of a ring.

        Parameters are those of `outward`.
        """
        if self.facets.shape[1] == 4:
            seen: Floats = np.linalg.norm(self.outward(facets, shares), axis=1)
            return seen
        if self.around is None:
            whole: Floats = self.areas[facets]
            return whole
        start, stop = (self.positions[self.facets[facets, k]] for k in (0, 1))
        ring = (shares * self.around[self.facets[facets]]).sum(axis=1)
        area: Floats = ring * np.linalg.norm(stop - start, axis=1)
        return area

    def of_nodes(self) -> Floats:
        """Return the area of each facet that belongs to each of its nodes, (F, nodes of a facet)."""
        width, every = self.facets.shape[1], np.arange(len(self.facets))
        of_nodes: Floats = np.repeat((self.areas / width)[:, None], width, axis=1)
        if width == 4:
            quad = REFERENCE_CELLS["quad"]
            points, _ = quad.shape_functions(quad.corners / np.sqrt(3.0))
            seen = [self.spread(every, np.tile(at, (every.size, 1)))[:, None] * at for at in points]
            of_nodes = 0.25 * np.sum(seen, axis=0)
        elif self.around is not None:
            here = self.around[self.facets]
            length = np.linalg.norm(self.outward(every, here), axis=1)
            of_nodes = length[:, None] * (2.0 * here + here[:, ::-1]) / 6.0
        return of_nodes


class Wall(NamedTuple):
    """A rigid plane wall.

    Attributes
    ----------
    point : (dim,) array
        A point of it [length].
    normal : (dim,) array
        Unit vector out of the wall, to the side where the body is.
    """

    point: Floats
    normal: Floats


class PairedPoints(NamedTuple):
    """The contact points of two surfaces. The gap of point p is ``gap[p]`` plus the sum of ``value[k] @ u[node[k]]``.

    The k are those from ``start[p]`` up to, but not including, ``start[p + 1]``. The force of a point on the node of an
    entry is its multiplier times `value`.

    Attributes
    ----------
    gap : (P,) array
        Gap at the start, negative where the surfaces overlap [length].
    weight : (P,) array
        Area of the surface that belongs to the point [length^2].
    normal : (P, dim) array
        Unit vector from the first surface to the second one.
    facets : (P, 2) array
        A facet of each surface on which the point lies; -1 at a wall.
    start : (P + 1,) array
        First entry of each point.
    node : (K,) array
        Number in the model of the node of each entry.
    value : (K, dim) array
        Derivative of the gap by the displacement of that node.
    """

    gap: Floats
    weight: Floats
    normal: Floats
    facets: Integers
    start: Integers
    node: Integers
    value: Floats


class Places(NamedTuple):
    """Contact points that keep their places on the first surface.

    Attributes
    ----------
    facets : (P,) array
        Facet on which each point lies.
    shares : (P, nodes of a facet) array
        Shape functions of that facet at the point.
    weight : (P,) array
        Area of the surface that belongs to the point [length^2].
    """

    facets: Integers
    shares: Floats
    weight: Floats


class FacingSurfaces(NamedTuple):
    """Two surfaces of a contact at the time t_n, as the kernel `Pairing.renew` reads them.

    Attributes
    ----------
    at : (n, dim) array
        Places of nodes [length].
    first, second : (F, nodes of a facet), (G, nodes of a facet) arrays
        Facets of both surfaces, as rows of `at`, whose nodes run as those of `Surface.facets`.
    points : (F, nodes of a facet) array
        Number of the contact point at each node of the first surface.
    area : (F,) array
        Area of each facet of the first surface at the start [length^2].
    low, high : (groups, dim) arrays
        Corners of the box around each `group` facets of the second surface that follow one another.
    group : int
    reach : float
        Half of the size of the first surface at the start: what overlaps by more is its other side [length].
    """

    at: Floats
    first: Integers
    second: Integers
    points: Integers
    area: Floats
    low: Floats
    high: Floats
    group: int
    reach: float


class RenewedPoints(NamedTuple):
    """Contact points at the nodes of a first surface, as the kernel `Pairing.renew` writes them in each step.

    Attributes
    ----------
    gap : (P,) array
        Gap at t_n [length].
    area : (P,) array
        Area that belongs to the point; 0 of one that meets nothing [length^2].
    normal : (P, dim) array
        Unit vector from the first surface to the second one.
    meets : (P,) array
        Number of nodes of the second surface that it meets.
    node, share : (P, most) arrays
        These, as rows of `FacingSurfaces.at`, and what each of them has in the motion of the gap: together 1.
    of_facets, of_points : (F, 2 most + 2, 6), (P, 3) arrays
        Room for what the kernel keeps of facets of the first surface, and of points, while it works.
    """

    gap: Floats
    area: Floats
    normal: Floats
    meets: Integers
    node: Integers
    share: Floats
    of_facets: Floats
    of_points: Floats


class Pairing(Component, contract="pairings"):
    """A way to make contact points of two surfaces of bodies that are not lines.

    Pairing and normals are those of the start; displacements are small. Where a contact has ``sliding: large``, the
    points either stay at their `places`, and the framework finds in each step what they meet, the nearest facet of the
    second surface; or they are at the nodes of the first surface, and a kernel `renew` finds in each step what they
    meet and their areas.

    Attributes
    ----------
    dimensions
        Numbers of dimensions of the surfaces that it pairs.
    passes_patch_test
        Whether a uniform pressure between meshes that do not match is transmitted exactly.
    convex
        Whether the gap of a point is a mean of those of its nodes, with shares that are not negative.
    more_points_than_nodes
        Whether there may be more points than nodes of the first surface. A law without compliance is then refused, as
        the motion is right and the single forces are not.
    renews
        Numbers of dimensions in which it has a kernel `renew`.
    mean_bound
        With such a kernel, largest ratio of two sums over the first surface, where the second one covers all of it: the
        squares of the motion of the second surface that the points see, times their areas, and the integral of the
        square of this motion.
    """

    dimensions: ClassVar[tuple[int, ...]] = (2, 3)
    passes_patch_test: ClassVar[bool] = False
    convex: ClassVar[bool] = True
    more_points_than_nodes: ClassVar[bool] = False
    renews: ClassVar[tuple[int, ...]] = ()
    mean_bound: ClassVar[float] = 1.0

    @abstractmethod
    def points(self, first: Surface, second: Surface | Wall) -> PairedPoints:
        """Return the contact points of two surfaces, or of a surface and a wall.

        Parameters
        ----------
        first
            The surface on which the points lie.
        second
            The surface or the wall that it meets.
        """

    def places(self, first: Surface, second: Surface | Wall) -> Places | None:  # noqa: ARG002
        """Return the points of the first surface that keep their places on it, in the order of `points`.

        All of them, whether they meet anything at the start or not. None, as here, where a pairing has no such points:
        it does not slide.

        Parameters are those of `points`.
        """
        return None

    @staticmethod
    def renew(surfaces: FacingSurfaces, points: RenewedPoints) -> None:
        """Write the points at the nodes of the first surface as both surfaces are at t_n; a kernel.

        At the start they are those of `points`, which leaves out nodes that meet nothing.

        Parameters
        ----------
        surfaces
            Both surfaces.
        points
            The points.
        """
        raise NotImplementedError
