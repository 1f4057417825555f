"""Checks of a case beyond its single sections: addresses, dimensions, doubles, and quantities with their owners.

Those of expectations hold for the measures of a study too: entries that do not suit a quantity, and times.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

from percuss.case.defaults import DEFAULTS, OF_SLIDING, WITHOUT_BARS
from percuss.case.quantities import first_key
from percuss.case.source import Source
from percuss.case.specs import (
    Address,
    BodySpec,
    CaseSection,
    ContactSpec,
    Expectation,
    MeasureSection,
    RecordSpec,
    RigidWall,
    Spot,
    quantity_named,
)
from percuss.case.type_words import found
from percuss.case.validation import Mistake, Reader
from percuss.case.yaml_text import KeyPath, dotted
from percuss.errors import suggestion
from percuss.jsonable import Data
from percuss.methods.interfaces import Element, Material, OptionError, Shape, SolidMaterial
from percuss.methods.registry import Registry

ROUND_OFF = 1e-9  # relative, of the end of a run that is computed from its steps


def after_the_end(during: tuple[float, float] | None, at: float | None, end: float) -> tuple[str, str, str] | None:
    """Return key, message and advice if an interval or a time begins after the end of a run, else None."""
    first = during[0] if during is not None else at
    if first is None or first <= end * (1.0 + ROUND_OFF):
        return None
    key, what = ("during", "an interval that begins") if during is not None else ("at", "a time")
    message = f"expected {what} at or before the end of the run, {end:.9g}, found {first:g}"
    return key, message, "Choose an earlier time, or make the run longer."


def misfits(
    section: Expectation | MeasureSection, owners: Mapping[str, Collection[str]], dimension: int
) -> Iterator[Mistake]:
    """Yield the entries of an expectation or a measure that do not suit its quantity, `owners` and dimension."""
    name, quantity, statistic = section.quantity, quantity_named(section.quantity), section.statistic
    takes = isinstance(section, MeasureSection)
    key = "take" if takes else statistic
    if section.at is not None and section.during is not None:
        yield Mistake(("at",), "has both `during` and `at`", "Keep one.", key=True)
    if quantity.axis is None:
        single = f"{name} is a single number of a run and has no"
        if statistic != "value":
            yield Mistake((key,), f"{single} {statistic}", "Remove `take:`." if takes else "Write `value:`.", key=True)
        for time in ("during", "at"):
            if getattr(section, time) is not None:
                yield Mistake((time,), f"{single} time", f"Remove `{time}:`.", key=True)
    elif statistic == "value" and section.at is None:
        advice = f"Add `at:`{', or `take: mean` or the like' if takes else ''}."
        yield Mistake(("at",), "missing (the time of the value)", advice, key=True)
    elif statistic != "value" and section.at is not None:
        message = f"{statistic} is taken over an interval, not at a time"
        yield Mistake(
            ("at",), message, f"Write `{'take: value' if takes else 'value:'}` instead, or `during:`.", key=True
        )
    for owner, words in (("contact", "a contact"), ("probe", "an end"), ("support", "a support")):
        if quantity.of != owner and getattr(section, owner) is not None:
            yield Mistake((owner,), f"{name} is not a quantity of {words}", f"Remove `{owner}:`.", key=True)
    if quantity.of == "probe" and section.probe is None:
        yield Mistake(("probe",), f"missing (the owner of {name})", "Add `probe:` with an end.", key=True)
    owner = quantity.of
    if owner in owners and (named := getattr(section, owner)) is not None and named not in owners[owner]:
        yield Mistake((owner,), f"there is no {owner} '{named}'", suggestion(named, owners[owner], "name"))
    components = dimension if quantity.of in {"probe", "support"} else 1
    if section.component >= components:
        limit = f"0 to {components - 1}" if components > 1 else "0 only"
        yield Mistake(("component",), f"expected {limit}, found {section.component}")


def completed(case: CaseSection, dimension: int, source: Source, registry: Registry) -> CaseSection:
    """Return a case without mistakes in which the computed fields of its parts are set.

    Vectors with fewer components than the case has dimensions are padded with zeros.
    """

    def padded(vector: tuple[float, ...]) -> tuple[float, ...]:
        return vector + (0.0,) * (dimension - len(vector))

    bodies = {}
    for name, body in case.bodies.items():
        start = body.start if isinstance(body.start, tuple) else (float(body.start),)
        bodies[name] = replace(body, name=name, at=padded(start), element=_element_of(body, registry))
    method = case.method
    if any(body.shape.cell != "line" for body in bodies.values()):
        usual = DEFAULTS["pairings"]
        pairing: Any = method.pairing or registry.get("pairings", usual)()
        law: Any = method.contact
        if source.get(("method", "contact")) is None:
            law = registry.get("contacts", WITHOUT_BARS["contacts"])()
        method = replace(method, contact=law, pairing=pairing)
    far: Any = case.method.pairing or registry.get("pairings", OF_SLIDING)() if dimension == 3 else method.pairing
    contacts = {}
    for name, contact in case.contacts.items():
        sliding = contact.sliding or _sliding_of(contact, bodies)
        contacts[name] = replace(
            contact,
            name=name,
            law=contact.method or method.contact,
            pairing=contact.pairing or (far if sliding == "large" and method.pairing else method.pairing),
            friction=contact.friction or method.friction,
            sliding=sliding,
        )
    loads = {}
    for name, load in case.loads.items():
        direction = load.given_direction or load.load.vector()
        direction = padded(direction) if direction is not None and any(direction) else None
        loads[name] = replace(load, name=name, direction=direction)
    expect = []
    for i, expectation in enumerate(case.expect):
        of_contact = quantity_named(expectation.quantity).of == "contact"
        named = expectation.contact or (next(iter(contacts)) if of_contact else None)
        expect.append(replace(expectation, contact=named, path=("expect", i)))
    return replace(case, bodies=bodies, contacts=contacts, loads=loads, expect=tuple(expect), method=method)


def _sliding_of(contact: ContactSpec, bodies: Mapping[str, BodySpec]) -> Literal["small", "large"]:
    """Return how a contact slides that does not say it: far between bodies of finite strain that do not turn around."""
    sides = [bodies[side.body] for side in contact.sides]
    finite = any(body.shape.cell != "line" and not body.material.linear for body in sides)
    return "large" if finite and len(sides) == 2 and sides[0].plane != "axisymmetric" else "small"


def _element_of(body: BodySpec, registry: Registry) -> Element:
    """Return the element of a body: the one that the case says, or the first one for the cells of its shape."""
    cell = body.shape.cell
    if cell == "line" or type(body.element) in _elements_of(cell, registry, body.plane):
        return body.element
    choices = _elements_of(cell, registry, body.plane)
    flows = body.material.state > 0
    made: Element = next((one for one in choices if flows and getattr(one, "isochoric", False)), choices[0])()
    return made


def _elements_of(cell: str, registry: Registry, plane: str | None) -> list[Any]:
    """Return the registered elements for a kind of cells in a plane."""
    classes: list[Any] = [registry.get("elements", name) for name in registry.names("elements")]
    about_axis = plane == "axisymmetric"
    found = [one for one in classes if one.cell == cell and getattr(one, "about_axis", False) == about_axis]
    return [one for one in found if plane != "stress" or getattr(one, "dimension", 2) == 2]


KINDS = {1: "a body along a line", 2: "a body in two dimensions", 3: "a body in three dimensions"}
# Keys without a meaning, by kind of body.
NOT_OF = {
    "a body along a line": ("thickness", "angle", "axis", "spin"),
    "a body of revolution": ("area", "thickness", "angle", "axis", "spin"),
    "a body in two dimensions": ("area", "axis"),
    "a body in three dimensions": ("area", "thickness", "plane"),
}


class CrossChecks:
    """Checks of the sections that have no mistakes of their own; mistakes are reported to the reader.

    Attributes
    ----------
    dimension
        Number of components of every vector in the case.
    """

    def __init__(self, reader: Reader) -> None:
        self.reader, self.wrong = reader, reader.wrong
        self.fixed: dict[str, tuple[Any, ...]] = {}
        self.axes: dict[KeyPath, Any] = {}  # along which regions are held
        self.ends: dict[str, Sequence[str] | None] = {}
        self.places: dict[str, str] = {}  # what they are called
        self.no_regions: dict[str, Mapping[str, str]] = {}
        self.vectors: list[tuple[KeyPath, int]] = []
        self._check_bodies()
        self._check_contacts()
        self._check_loads()
        record = reader.part(("record",))
        self._are_ends(("record", "probes"), (record and record.probes) or ())
        self.dimension = self._common_dimension()
        for at, axis in self.axes.items():
            if axis in list("xyz"[self.dimension :]):
                known = " or ".join("xyz"[: self.dimension])
                self.wrong(at, f"expected {known}, as the case has {self.dimension} dimensions, found {axis}")
        self._check_expectations()

    def _parts(self, section: str) -> Iterator[tuple[str, KeyPath, Data, Any]]:
        """Yield name, path, data and checked instance, or None, of each mapping in a section of named parts."""
        entries = self.reader.source.get((section,), {})
        for name, given in entries.items() if isinstance(entries, Mapping) else ():
            if isinstance(given, Mapping):
                yield name, (section, name), given, self.reader.part((section, name))

    def _component_key(self, family: str, given: Data) -> str:
        """Return the key of a mapping that is the name of a component, or an empty text."""
        names = self.reader.registry.names(family)
        return next((key for key in given if key in names), "")

    # ------------------------------------------------------------------------------------------- vectors

    def _note_vector(self, path: KeyPath, value: Any) -> None:
        """Note the length of a vector, which every other vector must have."""
        if isinstance(value, tuple):
            if 1 <= len(value) <= 3:
                self.vectors.append((path, len(value)))
            else:
                self.wrong(path, f"expected 1, 2 or 3 components, found {len(value)}")

    def _common_dimension(self) -> int:
        """Return the number of dimensions; vectors of another length than the first are wrong."""
        if not self.vectors:
            return 1
        first, dimension = self.vectors[0]
        for path, length in self.vectors[1:]:
            if length != dimension:
                where = f"{dotted(first)} ({self.reader.source.place(first)})"
                message = f"implies {length} dimensions, and {where} implies {dimension}"
                self.wrong(path, message, "All vectors of a case have one dimension.")
        return dimension

    # ----------------------------------------------------------------------------------------- addresses

    def _is_end(self, path: KeyPath, address: Address | Spot, *, whole_body: bool = False) -> bool:
        """Return whether an address is an end of the case, or, if allowed, a whole body."""
        body, region = address.body, address.region
        if body not in self.ends:
            self.wrong(path, f"there is no body '{body}'", suggestion(body, self.ends, "name"))
            return False
        ends, kind = self.ends[body], self.places[body]
        if not region and not whole_body:
            example = f"{body}.{ends[0]}" if ends else f"{body}.END"
            expected = "an end" if kind == "end" else "a region"
            self.wrong(path, f"expected {expected}, found the whole body '{body}'", f"Write as '{example}'.")
            return False
        if region and ends is not None and region not in ends:
            why = self.no_regions[body].get(region)
            message = f"the body '{body}' has no {kind} '{region}'{f': {why}' if why else ''}"
            self.wrong(path, message, suggestion(region, ends, kind))
            return False
        return True

    def _are_ends(
        self, path: KeyPath, addresses: Sequence[Address | Spot], *, whole_body: bool = False
    ) -> dict[KeyPath, Any]:
        """Return those addresses of a list that are ends of the case; an address that occurs twice is wrong."""
        good: dict[KeyPath, Any] = {}
        for i, address in enumerate(addresses):
            if isinstance(address, Spot):
                self._note_vector((*path, i, "at"), address.at)
            if self._is_end((*path, i), address, whole_body=whole_body or isinstance(address, Spot)):
                if address in addresses[:i]:
                    self.wrong((*path, i), f"{address} is named twice", "Keep one.")
                else:
                    good[*path, i] = address
        return good

    # ------------------------------------------------------------------------------------------- sections

    def _check_bodies(self) -> None:
        for name, path, given, body in self._parts("bodies"):
            key = self._component_key("shapes", given)
            # The shape and the vectors may be right where the body is wrong.
            shape = body.shape if body is not None else self.reader.part((*path, key))
            ends = getattr(shape or (self.reader.registry.get("shapes", key) if key else None), "regions", None)
            self.ends[name] = ends = ends if isinstance(ends, tuple) and ends else None
            self.no_regions[name] = shape.no_regions if shape is not None else {}
            self.places[name] = kind = "end" if shape is None or shape.cell == "line" else "region"
            if shape is not None and (dimension := shape.dimension()) is not None:
                self.vectors.append(((*path, key), int(dimension)))
            if shape is not None:
                self._check_section(name, path, given, shape)
            if shape is not None and body is not None:
                self._check_material(path, shape, body.material, body.plane)
                self._check_element(path, shape, body, named="element" in given)
            self._note_vector((*path, "at"), given.get("at"))
            self._note_vector((*path, "velocity"), given.get("velocity"))
            fixed = given.get("fixed", ())
            self.fixed[name] = fixed = fixed if isinstance(fixed, tuple) else ()
            for i, held in enumerate(fixed):
                at, end = (*path, "fixed", i), held
                if isinstance(held, Mapping):
                    at, end = (*at, "on"), held.get("on")
                    self.axes[*path, "fixed", i, "along"] = held.get("along")
                if not isinstance(end, str):
                    continue
                if ends is not None and end not in ends:
                    self.wrong(at, f"the body '{name}' has no {kind} '{end}'", suggestion(end, ends, kind))
                elif held in fixed[:i] or end in fixed[:i]:
                    self.wrong(at, f"the {kind} '{end}' is fixed twice", "Keep one.")

    def _check_section(self, name: str, path: KeyPath, given: Mapping[str, Any], shape: Shape) -> None:
        """Report an area that is missing, what has no meaning for a body of this kind, and vectors that are none."""
        dimension = 1 if shape.cell == "line" else shape.dimension() or 2
        kind = "a body of revolution" if given.get("plane") == "axisymmetric" and dimension == 2 else KINDS[dimension]
        for key in NOT_OF[kind]:
            if key in given:
                self.wrong((*path, key), f"{shape.name} is {kind}, which has no {key}", "Drop it.", key=True)
        if dimension == 1:
            if "area" not in given:
                message, advice = "missing (cross-section [length^2])", "Add `area:` to the body."
                self.wrong((*path, "area"), message, advice, key=True)
            return
        for key in ("axis", "spin"):
            self._note_vector((*path, key), given.get(key))
        if dimension == 3 and given.get("angle") and not given.get("axis"):
            self.wrong((*path, "axis"), "missing (the vector about which it is turned)", "Add `axis:`.", key=True)
        vectors = ("velocity", "at", "spin") if dimension == 3 else ("velocity", "at")
        for key in vectors:
            if key in given and not isinstance(given[key], tuple):
                message = f"expected a vector, as body '{name}' lies along no line, found {found(given[key])}"
                self.wrong((*path, key), message, "Give a number for each direction.")
        if dimension == 2 and isinstance(given.get("spin"), tuple):
            message = f"expected a number, as body '{name}' turns in its plane, found {found(given['spin'])}"
            self.wrong((*path, "spin"), message, "Positive is anticlockwise.")

    def _check_material(self, path: KeyPath, shape: Shape, material: Material, plane: str | None) -> None:
        """Report a material that is not for a body of this shape, and what it lacks."""
        dimension = 1 if shape.cell == "line" else shape.dimension()
        flat = dimension == 2 and plane != "axisymmetric"
        kernel = "stress" if dimension == 1 else "stress_2d" if flat else "stress_3d"
        if kernel == "stress_2d" and material.state > 0 and plane != "stress":
            kernel = "stress_3d"  # with nothing across
        if getattr(material, kernel, None) is None:
            of_shape = "bars" if dimension == 1 else f"bodies in {dimension} dimensions" if flat else "whole bodies"
            message = f"expected a material of {of_shape} for {shape.name}, found {material.name}"
            advice = material.elsewhere if dimension != 1 else ""
            self.wrong((*path, "material"), message, advice or f"It has no `{kernel}`: take another one.")
            return
        if dimension == 1 or not isinstance(material, SolidMaterial):
            return
        try:
            material.solid_parameters(plane or "strain" if flat else "")
        except OptionError as error:
            missing = error.path and getattr(material, str(error.path[0]), None) is None
            advice = "Add it to the material." if missing else ""
            self.wrong((*path, "material", *error.path), str(error), advice, key=True)

    def _check_element(self, path: KeyPath, shape: Shape, body: BodySpec, *, named: bool) -> None:
        """Report an element for other cells or planes than those of the body, and cells for which there is none."""
        element = body.element if named else None
        good = _elements_of(shape.cell, self.reader.registry, body.plane)
        if shape.cell == "line":
            good = [type(body.element)] if element is None or element.cell.startswith("line") else []
        if (element is None and good) or type(element) in good:
            simplex = shape.cell in {"triangle", "tetra"} and body.material.state > 0 and body.locking is None
            if simplex and getattr(element or good[0], "locks", False):
                found_one = f"{(element or good[0]).name} with {body.material.name}"
                message = f"expected cells that do not lock where a material flows, found {found_one}"
                advice = "Take quadrilaterals or hexahedra, or write `locking: accepted` in the body."
                self.wrong((*path, "element"), message, advice, key=element is None)
            return
        about = " about an axis" if body.plane == "axisymmetric" else ""
        of_shape = f"expected an element for the {shape.cell} cells of {shape.name}{about}"
        other = element is not None and element.cell == shape.cell
        found_one = f"{element.name}, which is for {element.cell} cells" if element is not None else "none registered"
        found_one += f"{' in a plane' if about else ' about an axis'}" if other else ""
        advice = f"Take {' or '.join(one.name for one in good)}." if good else "Name a plug-in that has one."
        self.wrong((*path, "element"), f"{of_shape}, found {found_one}", advice, key=element is None)

    def _check_contacts(self) -> None:
        pairs: dict[Any, str] = {}
        for name, path, _, contact in self._parts("contacts"):
            if contact is None:
                continue
            if isinstance(contact.wall, RigidWall):
                shape = contact.wall.shape
                of_shape, at = (contact.wall, ()) if shape == "plane" else (getattr(contact.wall, shape), (shape,))
                for key in ("point", "normal", "centre", "axis"):
                    self._note_vector((*path, "wall", *at, key), getattr(of_shape, key, None))
                loads = self.reader.source.get(("loads",), {})
                if (load := contact.wall.moving) is not None and load not in loads:
                    self.wrong((*path, "wall", "moving"), f"there is no load '{load}'", suggestion(load, loads, "load"))
            else:
                self._note_vector((*path, "wall"), contact.wall)
            between = contact.between is not None
            places = [(*path, "between", 0), (*path, "between", 1)] if between else [(*path, "body")]
            are_ends = [self._is_end(at, side) for at, side in zip(places, contact.sides, strict=True)]
            if not all(are_ends):
                continue
            pair = (frozenset(contact.sides), contact.wall)
            if between and len(pair[0]) == 1:
                self.wrong(places[1], f"the end {contact.sides[1]} is in contact with itself", "Name two ends.")
            elif between and len({side.body for side in contact.sides}) == 1:
                message = f"expected ends of two bodies, found {contact.sides[0]} and {contact.sides[1]} of one"
                self.wrong(places[1], message, "Name the end of the body that it meets.")
            elif pair in pairs:
                same = "ends" if between else "end and wall"
                self.wrong(path, f"the contact '{pairs[pair]}' has the same {same}", "Keep one of them.", key=True)
            else:
                pairs[pair] = name

    def _check_loads(self) -> None:
        walls = (getattr(contact, "wall", None) for *_, contact in self._parts("contacts"))
        moving = {wall.moving for wall in walls if isinstance(wall, RigidWall)}
        for load_name, path, given, load in self._parts("loads"):
            if load is None:
                continue
            key, at = self._component_key("loads", given), (*path, "on")
            moves, of_ends = load.acts_as == "velocity", load.acts_as not in {"force", "acceleration"}
            if isinstance(load.places, Address):
                places = {at: load.places} if self._is_end(at, load.places, whole_body=not of_ends) else {}
            else:
                places = self._are_ends(at, load.on, whole_body=not of_ends)
            for place, end in places.items():
                if moves and end.region in self.fixed[end.body]:
                    advice = f"Take it out of bodies.{end.body}.fixed."
                    self.wrong(place, f"{end} is fixed and cannot have a velocity", advice)
            if not load.on and (not load.load.everywhere or of_ends) and not (moves and load_name in moving):
                owner = "an end" if of_ends else "an end or a body"
                self.wrong(at, "missing (where the load acts)", f"Add `on:` with {owner}.", key=True)
            own = load.load.vector()
            if load.acts_as == "pressure" and (own is not None or load.given_direction is not None):
                advice = "Drop the direction, or write `as: traction`, which has one."
                self.wrong((*path, "as"), "a pressure acts along the normal into the body, and has a direction", advice)
            if own is not None and len(own) > 1:
                self._note_vector((*path, key), own)
                if load.given_direction is not None:
                    at = (*path, "along" if load.axis else "direction")
                    self.wrong(at, f"{key} is a vector already", "Keep one.", key=True)
            self._note_vector((*path, "direction"), load.along)
            if load.axis is not None:
                self.axes[*path, "along"] = load.axis

    # --------------------------------------------------------------------------------------- expectations

    def _check_expectations(self) -> None:
        items = self.reader.source.get(("expect",), ())
        loads = [(name, load) for name, *_, load in self._parts("loads")]
        supports = [name for name, load in loads if load is None or (load.acts_as == "velocity" and load.on)]
        for body, fixed in self.fixed.items():
            regions = dict.fromkeys(held.get("on") if isinstance(held, Mapping) else held for held in fixed)
            supports += [f"{body}.{region}" for region in regions]
        owners = {"contact": [name for name, *_ in self._parts("contacts")], "support": supports}
        for i in range(len(items) if isinstance(items, tuple) else 0):
            at, expectation = ("expect", i), self.reader.part(("expect", i))
            if expectation is not None:
                for mistake in misfits(expectation, owners, self.dimension):
                    self.reader.report(mistake, at)
                self._check_owner(at, expectation, owners)
                self._check_time(at, expectation)

    def _check_owner(self, path: KeyPath, expectation: Expectation, owners: Mapping[str, Sequence[str]]) -> None:
        """Report an owner that is missing, and a probe or an entry of the summary that the case has not."""
        name, of = expectation.quantity, quantity_named(expectation.quantity).of
        names = owners.get(of, ())
        reported = self.reader.problems and not names  # as mistakes in the contacts
        if of in owners and getattr(expectation, of) is None and len(names) != 1 and not reported:
            one = f"Add `{of}:` with one of: {', '.join(sorted(names))}."
            advice = one if names else f"The case has no {of}."
            self.wrong((*path, of), f"missing (the owner of {name})", advice, key=True)
        head, _, rest = name.partition(".")
        entries = {"bodies": self.ends, "contacts": owners["contact"], "supports": owners["support"]}.get(head)
        if rest and entries is not None and (key := first_key(rest, entries)[0]) not in {"*", *entries}:
            message = f"the summary of a run has no '{head}.{key}'"
            self.wrong((*path, "quantity"), message, suggestion(key, entries, "entry"))
        at = (*path, "probe")
        if of == "probe" and expectation.probe is not None and self._is_end(at, expectation.probe):
            self._check_recorded(at, expectation.probe)

    def _check_recorded(self, path: KeyPath, probe: Address) -> None:
        """Report a probe whose motion the case does not record; without `probes` that of the ends in contact is."""
        record = self.reader.part(("record",)) if "record" in self.reader.source.data else RecordSpec()
        contacts = [contact for *_, contact in self._parts("contacts")]
        # A run that overrides change may record other ends than those of which the file expects something.
        if record is None or None in contacts or self.reader.source.has_override("record", "contacts"):
            return
        in_contact = [side for contact in contacts for side in contact.sides]
        recorded = [str(end) for end in (in_contact if record.probes is None else record.probes)]
        if str(probe) not in recorded:
            message = f"expected an end whose motion is recorded, found {probe}"
            self.wrong(path, message, f"Add {probe} to record.probes.")

    def _check_time(self, path: KeyPath, expectation: Expectation) -> None:
        """Report a time after the end of the run, where the case alone says when that is."""
        time = self.reader.part(("time",))
        if time is None or time.known_end is None or self.reader.source.has_override("time"):
            return
        late = after_the_end(expectation.during, expectation.at, time.known_end)
        if late is not None:
            key, message, advice = late
            self.wrong((*path, key), message, advice)
