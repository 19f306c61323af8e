"""URDF: the steps from a base link to a tip."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rehab_opt.kinematics.denavit_hartenberg import TWO_TURNS
from rehab_opt.kinematics.link_capsules import CapsuleOnLink
from rehab_opt.kinematics.robot_file.steps import (
    Inertial,
    Joint,
    Step,
    moved,
    turned_by_quaternion,
    turned_by_rpy,
    unit_vector,
)
from rehab_opt.kinematics.robot_file.xml_tree import FARTHEST, Element, Source, xml_root
from rehab_opt.text_file import number_in, shown

__all__ = ["urdf_steps"]

Array = NDArray[np.float64]

SHAPES = {
    "sphere": (("radius", 1),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
    "box": (("size", 3),),
}
"""Collision shapes that become capsules, and their dimensions."""
READ = {
    "origin": ("xyz", "rpy", "quat_xyzw"),
    "parent": ("link",),
    "child": ("link",),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "velocity", "effort"),
    "mimic": ("joint", "multiplier", "offset"),
}
"""Known elements and attributes of a joint; unknown ones are reported in a note."""
OF_ROBOT = {"link", "joint", "material", "gazebo", "transmission", "ros2_control", "sensor"}
OF_LINK = {
    "inertial": ("origin", "mass", "inertia"),
    "visual": ("origin", "geometry", "material"),
    "collision": ("origin", "geometry", "material", "contact_coefficients", "verbose"),
    "contact": None,
    "sensor": None,
    "self_collision_checking": None,
}
"""Known elements of a robot and of a link, and their children; unknown ones are reported in a note. None allows any
child."""
QUATERNIONS = 1.1
"""First version of the format with quaternions in <origin>; readers of earlier versions ignore them."""
INFINITE = {f"{sign}{word}": float(f"{sign}inf") for sign in ("", "+", "-") for word in ("inf", "infinity")}
"""Spellings of an infinite limit."""
TURNING, SLIDING = ("revolute", "continuous"), ("prismatic",)
_NO_NUMBER = np.array([math.nan])


class _Tree(NamedTuple):
    """Links by name, the joint above each link except the root, and the links below each link."""

    links: Mapping[str, Element]
    carriers: Mapping[str, Element]
    carried: Mapping[str, Sequence[str]]


def urdf_steps(
    source: Source, *, base: str | None, tip: str | None, bodies: bool = False
) -> tuple[list[Step], list[str]]:
    """Steps from `base` (the root by default) to `tip` (the only leaf by default), and notes.

    With `bodies`, links get capsules around their <collision>. Branches on moving links, such as a camera or a
    gripper's fingers, are included with their joints at zero.

    Raises
    ------
    ProblemFileError : the file cannot be read. RobotFileError : the file is no URDF, its joints form no tree, the tip
        is not below the base, or a joint between them is invalid; with `bodies`, a collision mesh.
    """
    root = xml_root(source)
    if root.tag != "robot":
        expected = "a URDF, <robot>" + ("; from_mjcf reads this one" if root.tag == "mujoco" else "")
        raise source.refuse(f"line {root.line}", f"<{root.tag}>", expected)
    _refuse_xacro(root, source)
    tree = _tree(root, source)
    _refuse_early_quaternions(root, source)
    notes = list(dict.fromkeys(_unread(root)))
    way = _way(tree, base, tip, source)
    steps, moves = list[Step](), False
    on_way = {_child(joint) for joint in way}
    for joint in way:
        steps.append(_step(joint, tree.links, source, notes))
        moves = moves or steps[-1].joint is not None
        if moves:
            steps += _carried(steps[-1].link, on_way, tree, source, notes)
    if way:
        first = _parent(way[0])
        steps.insert(0, Step(np.eye(4), None, first, _inertial(tree.links[first], source, notes)))
    if bodies:
        steps = [
            each._replace(bodies=tuple(_bodies(tree.links[each.link], each.aside, source, notes))) for each in steps
        ]
    return steps, notes


def _carried(link: str, way: Container[str], tree: _Tree, source: Source, notes: list[str]) -> Iterator[Step]:
    """Steps to the links that branch off from `link` and do not belong to the chain."""
    hanging = [(link, np.eye(4))]
    while hanging:
        at, pose = hanging.pop()
        for child in tree.carried[at]:
            if child in way:
                continue
            joint = tree.carriers[child]
            name = joint.attributes["name"]
            there = pose @ _origin(joint, source, f"joint {name}", notes)
            if joint.attributes.get("type") != "fixed":
                notes.append(f"joint {name} is not between base and tip: link {child} is taken where it is at zero")
            hanging.append((child, there))
            yield Step(there, None, child, _inertial(tree.links[child], source, notes), aside=True)


def _unread(root: Element) -> Iterator[str]:
    """Notes on unknown elements of the robot and its links, such as misspelt ones."""
    for child in root.children:
        if child.tag not in OF_ROBOT:
            yield f"line {child.line}: <{child.tag}> is not read"
        if child.tag != "link":
            continue
        name = child.attributes["name"]
        for each in child.children:
            inside = OF_LINK.get(each.tag, ())
            if each.tag not in OF_LINK:
                yield f"link {name}: <{each.tag}> is not read"
            elif inside is not None:
                yield from (
                    f"link {name}, {each.tag}: <{of.tag}> is not read" for of in each.children if of.tag not in inside
                )
            if each.tag == "inertial" and len({"mass", "inertia"} & {of.tag for of in each.children}) == 1:
                yield f"link {name}, inertial: mass and inertia are read together alone; the link has none"


def _refuse_xacro(root: Element, source: Source) -> None:
    """Raise an error for xacro elements, under any prefix, and for xacro expressions in joints and link names."""
    name = source.path.name
    stem = name.removesuffix(".xacro").removesuffix(".urdf")
    plain = f"{stem}.urdf" if name != f"{stem}.urdf" else f"{stem}_expanded.urdf"  # else `>` would empty the file
    expected = f"a URDF; expand it first: xacro {name} > {plain}"
    spaces = (key for key, value in root.attributes.items() if value.rstrip("/").endswith("/xacro"))
    prefixes = {"xacro:", *(f"{key.removeprefix('xmlns:')}:" for key in spaces)}
    for element in root.all():
        if element.tag.startswith(tuple(prefixes)):
            raise source.refuse(f"line {element.line}", f"<{element.tag}>", expected)
    for element in (*root.each("link"), *(each for joint in root.each("joint") for each in joint.all())):
        for key, value in element.attributes.items():
            if "${" in value or "$(" in value:
                raise source.refuse(f"line {element.line}, {element.tag}.{key}", value, expected)


def _refuse_early_quaternions(root: Element, source: Source) -> None:
    version = root.attributes.get("version", "1.0")
    if number_in(version) >= QUATERNIONS:
        return
    expected = f'rpy, or <robot version="{QUATERNIONS}">: other readers leave it out in version {shown(version)}'
    for owner in (*root.each("joint"), *root.each("link")):
        for element in owner.all():
            if "quat_xyzw" in element.attributes:
                key = f"{owner.tag} {owner.attributes['name']}, {element.tag}.quat_xyzw"
                raise source.refuse(key, element.attributes["quat_xyzw"], expected)


def _tree(root: Element, source: Source) -> _Tree:
    links: dict[str, Element] = {}
    for link in root.each("link"):
        name = link.text("name", source, f"line {link.line}")
        if name in links:
            raise source.refuse(f"line {link.line}, link.name", name, "a name that no other link has")
        links[name] = link
    carriers: dict[str, Element] = {}
    carried: dict[str, list[str]] = {name: [] for name in links}
    names: set[str] = set()
    for joint in root.each("joint"):
        name = joint.text("name", source, f"line {joint.line}")
        if name in names:
            raise source.refuse(f"line {joint.line}, joint.name", name, "a name that no other joint has")
        names.add(name)
        parent, child = (_end(joint, end, links, source) for end in ("parent", "child"))
        if child in carriers:
            other = carriers[child].attributes["name"]
            raise source.refuse(f"joint {name}, child.link", child, f"a link of one parent ({other} has it, too)")
        if parent == child:
            raise source.refuse(f"joint {name}, child.link", child, "another link than its parent")
        carriers[child] = joint
        carried[parent].append(child)
    return _Tree(links, carriers, carried)


def _end(joint: Element, end: str, links: Mapping[str, Element], source: Source) -> str:
    owner = f"joint {joint.attributes['name']}"
    element = joint.only(end, source, owner)
    name = element.attributes.get("link") if element is not None else None
    if name is None or name not in links:
        raise source.refuse(f"{owner}, {end}.link", name, "a link of this file")
    return name


def _way(tree: _Tree, base: str | None, tip: str | None, source: Source) -> list[Element]:
    for argument, name in (("base", base), ("tip", tip)):
        if name is not None and name not in tree.links:
            raise source.refuse(argument, name, f"one of the links {_listed(tree.links)}")
    if tip is None:
        leaves = [name for name in tree.links if not tree.carried[name]]
        if not leaves:
            expected = "links of which one bears no other" if tree.links else "links and joints"
            raise source.refuse("tip", None, f"{expected}: {'these are a loop' if tree.links else 'there are none'}")
        if len(leaves) != 1:
            raise source.refuse("tip", None, f"the link where the arm ends, one of {_listed(leaves)}")
        tip = leaves[0]
    way: list[Element] = []
    at = tip
    while at != base and at in tree.carriers:
        joint = tree.carriers[at]
        if len(way) > len(tree.links):
            raise source.refuse(f"joint {joint.attributes['name']}, child.link", at, "a tree: this is below itself")
        way.append(joint)
        at = _parent(joint)
    if base is not None and at != base:
        raise source.refuse("tip", tip, f"a link below base = {base!r}; above it are {_listed(map(_parent, way))}")
    return way[::-1]


def _parent(joint: Element) -> str:
    return next(joint.each("parent")).attributes["link"]


def _child(joint: Element) -> str:
    return next(joint.each("child")).attributes["link"]


def _listed(names: Iterable[str]) -> str:
    known = list(names)
    return shown(", ".join(known), 120) + ("" if len(known) < 8 else f" ({len(known)})")


def _step(joint: Element, links: Mapping[str, Element], source: Source, notes: list[str]) -> Step:
    owner = f"joint {joint.attributes['name']}"
    child = _child(joint)
    origin = _origin(joint, source, owner, notes)
    kind = joint.attributes.get("type")
    if kind not in (*TURNING, *SLIDING, "fixed"):
        near = get_close_matches((kind or "").lower(), (*TURNING, *SLIDING, "fixed"), n=1)
        meant = f", such as {near[0]!r}" if near else "; let the chain begin or end at another link"
        raise source.refuse(f"{owner}, type", kind, f"revolute, continuous, prismatic or fixed{meant}")
    notes += [f"{owner}: <{tag}> is not read" for tag in dict.fromkeys(each.tag for each in joint.children)
              if tag not in READ]  # fmt: skip
    endless = ("lower", "upper") if kind == "continuous" else ()
    notes += [f"{owner}: {each.tag}.{key} is not read" for each in joint.children for key in each.attributes
              if key not in READ.get(each.tag, each.attributes) or key in endless]  # fmt: skip
    moving = None if kind == "fixed" else _joint(joint, kind, source, owner, notes)
    return Step(origin, moving, child, _inertial(links[child], source, notes))


def _joint(joint: Element, kind: str, source: Source, owner: str, notes: list[str]) -> Joint:
    element = joint.only("axis", source, owner)
    axis = np.array([1.0, 0.0, 0.0])  # default of URDF
    if element is not None:
        if "xyz" not in element.attributes:
            raise source.refuse(f"{owner}, axis.xyz", None, "three numbers")
        axis, note = unit_vector(element.numbers("xyz", source, owner, np.zeros(3)), source, f"{owner}, axis.xyz")
        if note:
            notes.append(note)
    limit = joint.only("limit", source, owner)
    mimic = joint.only("mimic", source, owner)
    lower, upper, velocity, effort = (
        math.nan
        if limit is None
        else INFINITE[limit.attributes[key].strip().lower()]
        if limit.attributes.get(key, "").strip().lower() in INFINITE
        else float(limit.numbers(key, source, owner, _NO_NUMBER)[0])
        for key in ("lower", "upper", "velocity", "effort")
    )
    if kind == "continuous":
        lower, upper = -math.inf, math.inf
    elif math.isnan(lower) != math.isnan(upper):  # URDF's default of a missing one is zero
        lower, upper = (0.0 if math.isnan(each) else each for each in (lower, upper))
    coupled = "" if mimic is None else mimic.text("joint", source, owner)
    effort = effort if effort > 0.0 else math.inf
    return Joint(joint.attributes["name"], kind in SLIDING, axis, lower, upper, velocity, coupled, effort)


def _origin(element: Element, source: Source, owner: str, notes: list[str]) -> Array:
    origin = element.only("origin", source, owner)
    if origin is None:
        return np.eye(4)
    pose = moved(*origin.numbers("xyz", source, owner, np.zeros(3), most=FARTHEST))
    roll, pitch, yaw = origin.numbers("rpy", source, owner, np.zeros(3), most=TWO_TURNS)
    written = origin.numbers("quat_xyzw", source, owner, np.array([0.0, 0.0, 0.0, 1.0]))
    if "quat_xyzw" not in origin.attributes:
        pose[:3, :3] = turned_by_rpy(roll, pitch, yaw)
        return pose
    key = f"{owner}, origin.quat_xyzw"
    if "rpy" in origin.attributes:
        raise source.refuse(key, origin.attributes["quat_xyzw"], "no rpy beside it: either says how it is turned")
    quaternion, note = unit_vector(written, source, key)
    notes += [note] if note else []
    pose[:3, :3] = turned_by_quaternion(np.roll(quaternion, 1))
    return pose


def _bodies(link: Element, aside: bool, source: Source, notes: list[str]) -> Iterator[CapsuleOnLink]:
    """Smallest capsules around the boxes (along their longest side), cylinders and spheres of a link."""
    name = link.attributes["name"]
    owner = f"link {name}"
    for collision in link.each("collision"):
        pose, geometry = _origin(collision, source, owner, notes), collision.only("geometry", source, owner)
        for shape in () if geometry is None else geometry.children:
            if shape.tag not in SHAPES:
                value = shape.attributes.get("filename", f"<{shape.tag}>")
                expected = f"{', '.join(SHAPES)}; or give the link's capsules, by CapsuleOnLink({name!r}, ...)"
                if aside:
                    notes.append(
                        f"{owner}, collision.{shape.tag} = {value}: nothing is kept clear of it; read are {expected}"
                    )
                    continue
                raise source.refuse(f"{owner}, collision.{shape.tag}", value, expected)
            sizes = [shape.numbers(key, source, owner, np.full(n, math.nan)) for key, n in SHAPES[shape.tag]]
            if not all(np.all(each > 0.0) for each in sizes):  # a missing size is NaN
                said = " ".join(f"{key}={shape.attributes.get(key)}" for key, _ in SHAPES[shape.tag])
                raise source.refuse(f"{owner}, collision.{shape.tag}", said, "sizes above 0 m")
            axis, radius = np.array([0.0, 0.0, 1.0]), float(sizes[0][0])
            half = float(sizes[1][0]) / 2 if len(sizes) > 1 else 0.0
            if shape.tag == "box":
                a, b, c = np.sort(sizes[0]).tolist()
                axis, half, radius = np.eye(3)[int(np.argmax(sizes[0]))], c / 2, math.hypot(a, b) / 2
            (x, y, z), (u, v, w) = ((pose[:3, 3] + sign * half * pose[:3, :3] @ axis).tolist() for sign in (-1.0, 1.0))
            yield CapsuleOnLink(name, (x, y, z), (u, v, w), radius)


def _inertial(link: Element, source: Source, notes: list[str]) -> Inertial | None:
    owner = f"link {link.attributes['name']}"
    element = link.only("inertial", source, owner)
    mass = None if element is None else element.only("mass", source, owner)
    inertia = None if element is None else element.only("inertia", source, owner)
    if element is None or mass is None or inertia is None:
        return None
    value = float(mass.numbers("value", source, owner, np.zeros(1))[0])
    if not value >= 0.0:
        raise source.refuse(f"{owner}, mass.value", value, "0 kg or more")
    pose = _origin(element, source, owner, notes)
    xx, xy, xz, yy, yz, zz = (
        float(inertia.numbers(key, source, owner, np.zeros(1))[0]) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return Inertial(value, pose[:3, 3], pose[:3, :3] @ matrix @ pose[:3, :3].T)
