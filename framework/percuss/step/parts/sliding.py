"""Surfaces that slide far: contact points find in each step what they meet, and their rows are those of this step.

N and the gap g(x_n) are those of the places x_n. The predicted gap is ``g(x_n) + N^T (u* - u_n)``, and the ledger
counts the work by the rows of the step.

A point that comes back to a surface which it had left, and lies inside it, takes an offset: its gap counts from there,
and the offset falls as the point comes out. Nothing is thrown out. The energy is bounded by a number that the run
computes: with ``d_n = max(0, -sigma lambda_n-2 - g(x_n) + N_n^T (u_n - u_n-1))`` of each point, contact work and stored
energy ``sigma / 4 (lambda_n^2 + lambda_n-1^2)`` never exceed ``R = sum of lambda_n d_n / 2`` under a law that is a
complementarity problem at the end of the step. Where the area of a point changes, and with it sigma, R also has
``(sigma_n - sigma_n-2) q / 4`` where sigma grows, q the smaller one of ``lambda_n-2^2`` and ``lambda_n^2 sigma_n /
sigma_n-2``. The term of the first step is that of an overlap that presses.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, Self

import numpy as np

from percuss.contact.features import Feature
from percuss.contact.frictions import frictions_of
from percuss.contact.moving_rows import mobilities, stiffness_of_points, with_rows_that_stay
from percuss.contact.near import GROUP, MOST, NOBODY, Partners, enclose, enclose_groups, meet, search
from percuss.contact.points import BY_END, FROM_LINE, Points
from percuss.contact.sliding import half_size, renewed_points, renews, sliding, surfaces_of, turning
from percuss.contact.walls import WallShape, direction_of, meet_wall, round_or_moving
from percuss.methods.interfaces import FacingSurfaces
from percuss.record_arrays import Records, empty_records
from percuss.step.actions import BEFORE_ACCOUNT, BEFORE_CONTACT, RECORD, Action
from percuss.step.part import Part, Setting
from percuss.step.records import Loads

if TYPE_CHECKING:
    from collections.abc import Mapping

    from percuss.case.specs import ContactSpec
    from percuss.contact.model import Model
    from percuss.methods.interfaces import Array, Floats, Integers, RenewedPoints

# What a contact that slides sums up.
BOOKS = np.dtype(
    [
        ("returned", "i8"),  # points that came back inside the other surface
        ("work", "f8"),  # contact work of points whose law is a complementarity problem
        ("stored", "f8"),  # what these store after the step
        ("renewal_so_far", "f8"),  # R
        ("overlap", "f8"),  # largest one at the start that presses, and its term
        ("pressed", "f8"),
        ("excess", "f8"),  # largest value of work + stored - R, less that term
        ("term", "f8"),  # largest term of R, its point in the loop and its time
        ("point", "i8"),
        ("time", "f8"),
        ("stiffness", "f8"),  # largest bound of what its stiffness adds to a squared frequency, and its time
        ("stiffest", "f8"),
    ]
)


class Slides(NamedTuple):
    """The contact points whose rows move."""

    points: Points
    boundary: Records  # percuss.step.records.BOUNDARY_DOF
    now: Records  # percuss.step.records.NOW
    totals: Records  # percuss.step.records.TOTAL
    partners: Partners
    which: Integers  # (S,) index of each in the loop
    seekers: int  # those before this one seek the nearest facet, the others are renewed by the kernel of their pairing
    own: Integers  # (S,) number of its own nodes, whose entries come first
    share: Floats  # (S, w) in the place of the point
    node: Integers  # (S, w) of the first surface, as a row of `start`
    start: Floats  # (nodes, dim) places of the boundary nodes at t = 0
    mobility: Floats  # (nodes, dim, dim) acceleration by a force
    watched: Integers  # nodes of the surfaces, as rows of `start`
    made: Floats  # (nodes, dim) places at the last search
    allowed: Floats  # (1,) how far nodes may be from there
    presses: Integers  # (S,) 1 where an overlap at the start is to press
    offset: Floats  # (S,)
    met: Integers  # (w,) nodes that the present point meets, as rows of `start`
    met_share: Floats  # (w,) their shares
    last: Floats  # (S, 2) multiplier and compliance of the last step and of the one before
    before: Floats
    stiffness: Floats  # (S,) of each point while it is closed, 0 under a complementarity law
    load: Floats  # (nodes,) what the points add to a squared frequency
    books: Records  # (contacts,) BOOKS
    renewal: Floats  # (R, contacts) history of R


class Renewed(NamedTuple):
    """The points of a contact that the kernel of their pairing renews."""

    slides: Slides
    surfaces: FacingSurfaces
    points: RenewedPoints
    start: int  # the first of them
    first: int  # the facets of the second surface are those from first to last
    last: int


class AtWall(NamedTuple):
    """The points of a contact at a wall that is round or moves."""

    slides: Slides
    loads: Loads
    wall: WallShape
    place: int  # of the wall, as a row of `start`
    column: int  # of the amplitudes, that of its velocity
    direction: Floats  # (dim,) along which it moves
    first: int  # the points are those from first to last
    last: int


class Sliding(Part[Slides]):
    """The part of a step that writes rows anew: of surfaces that slide far, and at walls that are round or move.

    Parameters
    ----------
    data
        All points whose rows it writes.
    walls
        Those of each contact with such a wall.
    renewed
        Those of each contact whose pairing renews them, with the contact.
    """

    def __init__(self, data: Slides, walls: list[AtWall], renewed: list[tuple[Renewed, ContactSpec]]) -> None:
        super().__init__(data)
        self.walls, self.renewed = walls, renewed

    @classmethod
    def of(cls, setting: Setting, before: Self | None) -> Self | None:
        """Return the part, None where all rows stay."""
        if not setting.model.contact_points.slides.any():
            return None
        step = setting.step
        found = before.data if before is not None else _slides(setting)
        mobility = mobilities(setting.model, setting.place, setting.midpoint)
        stiffness = _stiffness(setting.model)[np.array(setting.order, dtype=np.int64)[found.which]]
        found = found._replace(mobility=mobility, stiffness=stiffness)
        found = found._replace(points=step.points, boundary=step.boundary, now=step.now, totals=step.totals)
        return cls(found, list(_at_walls(setting, found)), list(_renewed(setting.model, found)))

    def actions(self) -> Iterator[Action]:
        """Yield the actions of a step."""
        if self.data.watched.size:
            yield Action(BEFORE_CONTACT, renew_rows, self.data, order=1)
        for wall in self.walls:
            yield Action(BEFORE_CONTACT, renew_at_wall, wall, order=1)
        for renewed, spec in self.renewed:
            pairing: Any = spec.pairing
            about: Any = {"of_plugin": True, "allocates": pairing.allocates, "name": f"pairing {pairing.name}"}
            yield Action(BEFORE_CONTACT, renew_points, renewed, {renew: type(pairing).renew}, order=2, **about)
        yield Action(BEFORE_ACCOUNT, bound_energy, self.data)
        if self.data.stiffness.any():
            yield Action(BEFORE_ACCOUNT, bound_stiffness, self.data)
        yield Action(RECORD, record_renewal, self.data)

    def changing_arrays(self) -> list[Array]:
        """Return partners and candidates, offsets, multipliers and sums."""
        data, partners = self.data, self.data.partners
        found = [partners.candidates, partners.candidate_count, partners.partner, data.made, data.allowed]
        return [*found, data.offset, data.last, data.before, data.books, data.points.normal]

    def sums_of_records(self) -> Mapping[str, Floats]:
        """Return what each contact has summed up."""
        return {str(name): np.asarray(self.data.books[name], dtype=float) for name in BOOKS.names or ()}

    def results(self) -> Mapping[str, Floats]:
        """Return the bound R of each contact."""
        return {"renewal": self.data.renewal}


# ------------------------------------------------------------------------------------------------------------ its data


def _slides(setting: Setting) -> Slides:
    """Return the points that slide, and the facets that they may meet, with all sums at zero."""
    from scipy.spatial import cKDTree

    model, dim, place = setting.model, setting.model.dim, setting.place
    loop, points = np.argsort(np.array(setting.order, dtype=np.int64)), model.contact_points
    number = np.zeros(model.bodies.n_nodes, dtype=np.int64)
    number[list(place)] = np.array(list(place.values()), dtype=np.int64) // dim
    facets: list[Any] = []
    names = ("which", "own", "share", "node", "span", "skin", "presses")
    of_points: dict[str, list[Any]] = {name: [] for name in names}
    watched, seekers = [], 0
    for name, spec in _in_order(model):
        first, *others = surfaces_of(spec, model.bodies)
        where = np.flatnonzero(points.of_contact(name))
        begin = sum(len(one) for one, *_ in facets)
        for second in others:
            order = cKDTree(second.positions[second.facets].mean(axis=1)).indices
            of_facets = (number[second.nodes[second.facets]], *second.rims(), np.arange(len(order)))
            facets.append((*(one[order] for one in of_facets), _size(second)))
            watched += [number[first.nodes], number[second.nodes]]
        width = others[0].facets.shape[1] if others else 1
        own = np.ones(where.size, dtype=np.int64) if renews(spec, dim) else points.count[where] - width
        seekers += where.size if others and not renews(spec, dim) else 0
        share, node = np.zeros((where.size, 4)), np.zeros((where.size, 4), dtype=np.int64)
        for s, p in enumerate(where.tolist()):
            entries = slice(points.start[p], points.start[p] + own[s])
            share[s, : own[s]], node[s, : own[s]] = -points.share[entries], number[points.node[entries]]
        of_points["which"].append(loop[where])
        of_points["own"].append(own)
        of_points["share"].append(share)
        of_points["node"].append(node)
        end = begin + sum(len(second.facets) for second in others)
        of_points["span"].append(np.tile([begin, end], (where.size, 1)))
        of_points["skin"].append(np.full(where.size, facets[-1][4] if others else 0.0))
        of_points["presses"].append(np.full(where.size, int(spec.overlap == "press")))
    joined = {name: np.concatenate(arrays) for name, arrays in of_points.items()}
    count, contacts = joined["which"].size, len(model.case.contacts)
    most, room = max((one.shape[1] for one, *_ in facets), default=1), int(points.count.max())
    none = np.zeros(0, dtype=np.int64)
    widths = np.concatenate([none, *(np.full(len(one), one.shape[1]) for one, *_ in facets)])

    def wide(k: int) -> Integers:
        """Return arrays of all contacts, (F, most), with zeros where facets have fewer nodes."""
        padded = (np.pad(one[k], ((0, 0), (0, most - one[k].shape[1]))) for one in facets)
        return np.concatenate([none.reshape(0, most), *padded]).astype(np.int64)

    walls = [wall.point for wall, _ in round_or_moving(model.case).values()]
    start = np.concatenate([model.bodies.nodes[list(place)], np.reshape(walls, (-1, dim))])
    partners = Partners(
        rank=np.concatenate([none, *(one[3] for one in facets)]), node=wide(0), width=widths, rim=wide(1),
        corner=wide(2), group_low=np.zeros((widths.size, dim)), group_high=np.zeros((widths.size, dim)),
        at=start.copy(), skin=joined["skin"],
        candidates=np.tile(joined["span"][:, :1], MOST[dim]), candidate_count=np.zeros(count, dtype=np.int64),
        partner=np.full(count, NOBODY), first=joined["span"][:, 0].copy(), last=joined["span"][:, 1].copy(),
        low=np.zeros((widths.size, dim)), high=np.zeros((widths.size, dim)), share=np.zeros(most), trial=np.zeros(most),
        point=np.zeros(dim), out=np.zeros(dim), place=np.zeros(dim), other=np.zeros(dim),
    )  # fmt: skip
    return Slides(
        points=setting.step.points, boundary=setting.step.boundary, now=setting.step.now, totals=setting.step.totals,
        partners=partners,
        which=joined["which"], seekers=seekers, own=joined["own"], share=joined["share"], node=joined["node"],
        start=start, mobility=np.zeros((len(start), dim, dim)),
        watched=np.unique(np.concatenate([none, *watched])), made=start.copy(),
        allowed=np.full(1, -1.0), presses=joined["presses"], offset=np.zeros(count),
        met=np.zeros(room, dtype=np.int64), met_share=np.zeros(room), last=np.zeros((count, 2)),
        before=np.zeros((count, 2)), stiffness=np.zeros(count), load=np.zeros(len(start)),
        books=empty_records(contacts, BOOKS), renewal=np.full((setting.record.energy.size, contacts), np.nan),
    )  # fmt: skip


def _in_order(model: Model) -> list[tuple[str, ContactSpec]]:
    """Return the contacts that slide: those whose points seek the nearest facet, then at walls, then the others."""
    known = sliding(model.case).items()
    return sorted(known, key=lambda one: 2 if renews(one[1], model.dim) else int(one[1].wall is not None))


def _at_walls(setting: Setting, data: Slides) -> Iterator[AtWall]:
    """Yield the points of each contact with a wall that is round or moves."""
    case, dim, first = setting.model.case, setting.model.dim, data.seekers
    places = {name: len(setting.place) + k for k, name in enumerate(round_or_moving(case))}
    columns = ["", *case.loads]
    for name, (wall, load) in round_or_moving(case).items():
        last = first + int(setting.model.contact_points.of_contact(name).sum())
        column = len(columns) + columns.index(load.name) if load is not None else 0
        yield AtWall(data, setting.step.loads, wall, places[name], column, direction_of(load, dim), first, last)
        first = last


def _renewed(model: Model, data: Slides) -> Iterator[tuple[Renewed, ContactSpec]]:
    """Yield the points of each contact whose pairing renews them."""
    begin, start, partners, points = 0, 0, data.partners, model.contact_points
    for name, spec in _in_order(model):
        where, (first, *others) = points.of_contact(name), surfaces_of(spec, model.bodies)
        count, end = int(where.sum()), begin + sum(len(second.facets) for second in others)
        if renews(spec, model.dim):
            groups = slice(begin, end, GROUP)
            surfaces = FacingSurfaces(
                partners.at, data.node[start : start + count, 0][first.facets],
                partners.node[begin:end, : others[0].facets.shape[1]], first.facets, first.areas,
                partners.group_low[groups], partners.group_high[groups], GROUP, half_size(first),
            )  # fmt: skip
            room = renewed_points(first, int(points.count[where].max()) - 1)
            yield Renewed(data, surfaces, room, start, begin, end), spec
        begin, start = end, start + count


def _stiffness(model: Model) -> Floats:
    """Return the stiffness of each point while it is closed, (P,), the larger one of those across and along."""
    found = stiffness_of_points(model)
    for friction in frictions_of(model):
        along = np.divide(1.0, friction.compliance, out=np.zeros(friction.where.size), where=friction.compliance > 0.0)
        found[friction.where] = np.where(found[friction.where] > 0.0, np.maximum(found[friction.where], along), 0.0)
    return found


def _size(surface: Any) -> float:
    """Return the middle one of the sizes of the facets of a surface."""
    return float(np.median(np.ptp(surface.positions[surface.facets], axis=1).max(axis=1)))


# ------------------------------------------------------------------------------------------------------------- kernels


def renew(surfaces: FacingSurfaces, points: RenewedPoints) -> None:
    """Write the points at the nodes of a first surface (slot for the kernel of the pairing)."""
    raise NotImplementedError


def renew_rows(data: Slides, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Find what each point meets at t_n that seeks the nearest facet, and write its row."""
    partners = data.partners
    searches = move(data)
    enclose(partners)
    for s in range(data.seekers if searches else 0):
        if s == 0 or partners.first[s] != partners.first[s - 1]:
            enclose_groups(partners, partners.first[s], partners.last[s])
    for s in range(data.seekers):
        for d in range(partners.point.size):
            partners.point[d] = 0.0
            for k in range(data.own[s]):
                partners.point[d] += data.share[s, k] * partners.at[data.node[s, k], d]
        if searches:
            data.allowed[0] = min(data.allowed[0], search(partners, s))
        had = partners.partner[s] != NOBODY
        gap, f = meet(partners, s), partners.partner[s]
        if f == NOBODY:
            no_row(data, s)
            continue
        for k in range(partners.width[f]):
            data.met[k], data.met_share[k] = partners.node[f, k], partners.share[k]
        settle(data, s, n, had, partners.width[f], gap)


def renew_points(renewed: Renewed, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Let a pairing find what the nodes of a first surface meet at t_n, and write their rows."""
    data, points = renewed.slides, renewed.points
    partners = data.partners
    enclose_groups(partners, renewed.first, renewed.last)
    renew(renewed.surfaces, points)
    for p in range(points.gap.size):
        s, had = renewed.start + p, partners.partner[renewed.start + p] != NOBODY
        if points.area[p] <= 0.0:
            partners.partner[s] = NOBODY
            no_row(data, s)
            continue
        partners.partner[s] = renewed.first  # any facet serves
        for d in range(partners.out.size):
            partners.out[d] = -points.normal[p, d]
        for k in range(points.meets[p]):
            data.met[k], data.met_share[k] = points.node[p, k], points.share[p, k]
        law, row = data.points.law[data.which[s]], data.points.row[data.which[s]]
        row.weight, row.sigma = points.area[p], law.sigma * (law.weight / points.area[p])
        settle(data, s, n, had, points.meets[p], points.gap[p])


def renew_at_wall(at: AtWall, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Move a wall, and write the rows of its points as they are at t_n."""
    data, partners, dim = at.slides, at.slides.partners, at.direction.size
    for d in range(dim):
        q = data.boundary[at.place * dim + d]
        partners.other[d] = data.start[at.place, d] + q.old_u
        q.new_v = at.loads.amplitudes[at.column] * at.direction[d]
    data.met[0], data.met_share[0] = at.place, 1.0
    for s in range(at.first, at.last):
        for d in range(dim):
            partners.point[d] = 0.0
            for k in range(data.own[s]):
                r = data.node[s, k]
                partners.point[d] += data.share[s, k] * (data.start[r, d] + data.boundary[r * dim + d].old_u)
        had, partners.partner[s] = partners.partner[s] != NOBODY, 0
        settle(data, s, n, had, 1, meet_wall(at.wall, partners.other, partners.point, partners.out))


def settle(data: Slides, s: int, n: int, had: bool, count: int, gap: float) -> None:
    """Write the row of a point that meets `count` nodes, with its offset; `had` tells whether it met any before."""
    overlap = max(0.0, -gap)
    if had:
        data.offset[s] = min(data.offset[s], overlap)
    else:
        data.offset[s] = 0.0 if n == 0 and data.presses[s] == 1 else overlap
        if n > 0 and overlap > 0.0:
            data.books[data.points.law[data.which[s]].contact].returned += 1
    write_row(data, s, count, gap + data.offset[s])
    if n == 0:
        put_in(data, s, overlap - data.offset[s])


def move(data: Slides) -> bool:
    """Set the places of the nodes to those at t_n; return whether candidates are to be searched anew."""
    at, dim, farthest = data.partners.at, data.start.shape[1], 0.0
    for k in range(data.watched.size):
        r, square = data.watched[k], 0.0
        for d in range(dim):
            at[r, d] = data.start[r, d] + data.boundary[r * dim + d].old_u
            moved = at[r, d] - data.made[r, d]
            square += moved * moved
        farthest = max(farthest, square)
    if data.allowed[0] >= 0.0 and farthest <= data.allowed[0] * data.allowed[0]:
        return False
    data.allowed[0] = np.inf
    for k in range(data.watched.size):
        for d in range(dim):
            data.made[data.watched[k], d] = at[data.watched[k], d]
    return True


def put_in(data: Slides, s: int, overlap: float) -> None:
    """Count the energy of an overlap at the start that presses as put in, with the force that it brings."""
    row, book = data.points.row[data.which[s]], data.books[data.points.law[data.which[s]].contact]
    book.overlap = max(book.overlap, overlap)
    softness = row.sigma + row.response * row.delassus
    if softness > 0.0:
        data.totals[0].began_with += 0.5 * overlap * overlap / softness


def no_row(data: Slides, s: int) -> None:
    """Write the row of a point that meets nothing: no entries, and a gap of a facet, so that no force follows."""
    law, row = data.points.law[data.which[s]], data.points.row[data.which[s]]
    row.stop = row.start
    row.delassus = 1.0
    row.weight, row.sigma = law.weight, law.sigma
    row.initial_gap = data.partners.skin[s]
    data.offset[s] = 0.0


def write_row(data: Slides, s: int, count: int, gap: float) -> None:
    """Write the entries, the gap and the diagonal of S of a point that meets `count` nodes."""
    i = data.which[s]
    points, out, dim = data.points, data.partners.out, data.start.shape[1]
    law, row = points.law[i], points.row[i]
    for d in range(dim):
        points.normal[i, d] = -out[d]
    row.stop = row.start + (data.own[s] + count) * dim
    row.delassus = 0.0
    row.initial_gap = gap
    for k in range(data.own[s] + count):
        if k < data.own[s]:
            r, share = data.node[s, k], data.share[s, k]
        else:
            r, share = data.met[k - data.own[s]], -data.met_share[k - data.own[s]]
        for d in range(dim):
            entry = points.entries[row.start + k * dim + d]
            entry.place = r * dim + d
            entry.normal = share * out[d]
            entry.response = 0.0
            for c in range(dim):
                entry.response += data.mobility[r, d, c] * share * out[c]
            row.delassus += entry.normal * entry.response
            row.initial_gap -= entry.normal * data.boundary[entry.place].old_u
    if row.delassus == 0.0:  # all nodes are held
        row.delassus = 1.0
    if law.stores == BY_END:
        row.kappa = law.weight_gap / (row.sigma + law.surplus * row.delassus)


def bound_energy(data: Slides, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Add up the contact work of points under a complementarity law, what they store, and the bound R of both."""
    points, now = data.points, data.now[0]
    for c in range(data.books.size):
        data.books[c].stored = 0.0
    for s in range(data.which.size):
        i = data.which[s]
        law, row, state, last, before = points.law[i], points.row[i], points.state[i], data.last[s], data.before[s]
        if law.source == FROM_LINE and law.always == 1 and law.never_pulls == 1 and law.sees_predicted_gap == 1:
            book, sigma, force = data.books[law.contact], row.sigma / law.weight_gap, state.multiplier
            drop = -sigma * before[0] - (state.gap - now.dt * state.rate)
            term = 0.5 * force * max(0.0, drop)
            if sigma > before[1] and before[0] > 0.0:
                square = min(before[0] * before[0], sigma / before[1] * force * force)
                term += 0.25 * (sigma - before[1]) * square
            rate = 0.0
            for e in range(row.start, row.stop):
                rate += points.entries[e].normal * data.boundary[points.entries[e].place].new_v
            book.work += 0.5 * now.dt * force * (state.rate + rate)
            book.stored += 0.25 * (sigma * force * force + last[1] * last[0] * last[0])
            if n == 0:
                book.pressed += term
            else:
                book.renewal_so_far += term
            if n > 0 and term > book.term:
                book.term, book.point, book.time = term, i, now.time
            before[0], before[1] = last[0], last[1]
            last[0], last[1] = force, sigma
    for c in range(data.books.size):
        book = data.books[c]
        book.excess = max(book.excess, book.work + book.stored - book.renewal_so_far - book.pressed)


def bound_stiffness(data: Slides, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Bound what the stiffness of each contact adds to a squared frequency, by the largest sum of a row of nodes."""
    points, dim = data.points, data.start.shape[1]
    for s in range(data.which.size):
        i = data.which[s]
        row, law, normal = points.row[i], points.law[i], points.normal[i]
        book, whole = data.books[law.contact], 0.0
        if s == 0 or law.contact != points.law[data.which[s - 1]].contact:
            for r in range(data.load.size):
                data.load[r] = 0.0
        for e in range(row.start, row.stop, dim):
            if data.boundary[points.entries[e].place].mass > 0.0:  # nothing moves a wall
                whole += abs(share_of(points, e, normal))
        whole *= data.stiffness[s] * (row.weight / law.weight)
        for e in range(row.start, row.stop, dim):
            r = points.entries[e].place // dim
            if data.boundary[r * dim].mass > 0.0:
                data.load[r] += whole * abs(share_of(points, e, normal)) / data.boundary[r * dim].mass
            if data.load[r] > book.stiffness:
                book.stiffness, book.stiffest = data.load[r], data.now[0].time


def share_of(points: Points, e: int, normal: Floats) -> float:
    """Return the share of a node in a row of N, whose entries begin at e."""
    share = 0.0
    for d in range(normal.size):
        share += points.entries[e + d].normal * normal[d]
    return share


def record_renewal(data: Slides, n: int, u: Floats, v: Floats, a: Floats) -> None:
    """Record the bound R of each contact."""
    for c in range(data.books.size):
        data.renewal[data.now[0].row, c] = data.books[c].renewal_so_far


# ------------------------------------------------------------------------------------------------------- what it says

MOVES = "rows of contacts that slide change from step to step, and nothing is known of the product of such steps"


def feature(model: Model) -> Feature | None:
    """Return what is to know of rows that change from step to step; None where none does."""
    if not (model.contact_points.slides.any() and turning(model.case)):
        return None
    return Feature(
        name="sliding surfaces",
        held=with_rows_that_stay,
        held_words=("With the rows of the start", "closed at the start", "closed later"),
        reasons={"certificate": MOVES, "plain bars": "surfaces that slide are no bars"},
    )
