"""Writes topics for BIM viewers: BIM Collaboration Format 2.1 or 3.0 (buildingSMART), a zip of XML files."""

import io
import uuid
import zipfile
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Literal
from xml.etree.ElementTree import Element, SubElement, indent, tostring

import numpy as np
from numpy.typing import NDArray

from data.common.files import write_atomically

Xyz = tuple[float, float, float]
Version = Literal["2.1", "3.0"]
AUTHOR, TYPE, STATUS = "sgslam", "Deviation", "Open"
_WIDE = 4 / 3  # width of a view over its height
_BACK, _UP = 5.0, 3.0  # m from what is shown to the camera
_STAMP = (1980, 1, 1, 0, 0, 0)  # of the files in the zip: the same topics give the same bytes


@dataclass(frozen=True)
class Topic:
    """A finding. `global_ids` are the products concerned, drawn in `color` (AARRGGBB); `segment` is its place (two
    points, metres, the model's world coordinates), `towards` (x, y) the side of the camera.
    """

    title: str
    description: str
    label: str
    global_ids: tuple[str, ...]
    color: str
    segment: tuple[Xyz, Xyz]
    towards: tuple[float, float]


@dataclass(frozen=True)
class Model:
    """The IFC file that the topics refer to; `project` is the GlobalId of its IfcProject, empty if unknown."""

    filename: str
    project: str = ""


def write_bcf(path: Path | str, topics: list[Topic], model: Model, created: datetime, version: Version = "2.1") -> None:
    """Writes the topics atomically; `created` has a time zone. Topics without a product are drawn as lines."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        _add(archive, "bcf.version", _version(version))
        if version == "3.0":
            _add(archive, "extensions.xml", _extensions(topics))
        for number, topic in enumerate(topics, 1):
            guid = _guid(f"{number}/{topic.title}/{topic.global_ids}/{topic.segment}")
            _add(archive, f"{guid}/markup.bcf", _markup(guid, number, topic, model, created, version))
            _add(archive, f"{guid}/viewpoint.bcfv", _viewpoint(guid, topic, version))
    write_atomically(path, packed.getvalue())


def _add(archive: zipfile.ZipFile, name: str, root: Element) -> None:
    indent(root)
    text = tostring(root, encoding="UTF-8", xml_declaration=True)
    entry = zipfile.ZipInfo(name, _STAMP)
    entry.compress_type = zipfile.ZIP_DEFLATED
    archive.writestr(entry, text)


def _guid(name: str) -> str:
    return str(uuid.uuid5(uuid.NAMESPACE_OID, name))


def _version(version: Version) -> Element:
    root = Element("Version", VersionId=version)
    if version == "2.1":
        SubElement(root, "DetailedVersion").text = version
    return root


def _extensions(topics: list[Topic]) -> Element:
    """The values that topics may have, in the schema's order."""
    root = Element("Extensions")
    labels = dict.fromkeys(topic.label for topic in topics)
    used = {"TopicType": [TYPE], "TopicStatus": [STATUS], "Priority": [], "TopicLabel": labels, "User": [AUTHOR]}
    lists = ("TopicTypes", "TopicStatuses", "Priorities", "TopicLabels", "Users", "SnippetTypes", "Stages")
    for name, values in zip(lists, [*used.items(), ("SnippetType", []), ("Stage", [])], strict=True):
        own = SubElement(root, name)
        for value in values[1]:
            SubElement(own, values[0]).text = value
    return root


def _markup(guid: str, number: int, topic: Topic, model: Model, created: datetime, version: Version) -> Element:
    """The elements in the schema's order; 3.0 has lists of files, labels and views, and the views in the topic."""
    new = version == "3.0"
    root = Element("Markup")
    header = SubElement(root, "Header")
    file = SubElement(SubElement(header, "Files") if new else header, "File")
    file.set("IsExternal" if new else "isExternal", "true")
    if model.project:
        file.set("IfcProject", model.project)
    SubElement(file, "Filename").text = model.filename
    about = SubElement(root, "Topic", Guid=guid, TopicType=TYPE, TopicStatus=STATUS)
    SubElement(about, "Title").text = topic.title
    SubElement(about, "Index").text = str(number)
    labels = SubElement(about, "Labels")
    (SubElement(labels, "Label") if new else labels).text = topic.label
    SubElement(about, "CreationDate").text = created.isoformat(timespec="seconds")
    SubElement(about, "CreationAuthor").text = AUTHOR
    if topic.description or not new:
        SubElement(about, "Description").text = topic.description
    views = SubElement(SubElement(about, "Viewpoints"), "ViewPoint") if new else SubElement(root, "Viewpoints")
    views.set("Guid", _guid(f"{guid}/view"))
    SubElement(views, "Viewpoint").text = "viewpoint.bcfv"
    return root


def _viewpoint(guid: str, topic: Topic, version: Version) -> Element:
    root = Element("VisualizationInfo", Guid=_guid(f"{guid}/view"))
    components = SubElement(root, "Components")
    if topic.global_ids:
        _components(SubElement(components, "Selection"), topic)
    SubElement(components, "Visibility", DefaultVisibility="true")
    if topic.global_ids:
        color = SubElement(SubElement(components, "Coloring"), "Color", Color=topic.color)
        _components(SubElement(color, "Components") if version == "3.0" else color, topic)
    camera = _camera(root, topic)
    if version == "3.0":
        SubElement(camera, "AspectRatio").text = f"{_WIDE:.4f}"
    if not topic.global_ids:
        line = SubElement(SubElement(root, "Lines"), "Line")
        for name, point in zip(("StartPoint", "EndPoint"), topic.segment, strict=True):
            _vector(line, name, np.array(point))
    return root


def _components(parent: Element, topic: Topic) -> None:
    for global_id in topic.global_ids:
        SubElement(parent, "Component", IfcGuid=global_id)


def _camera(root: Element, topic: Topic) -> Element:
    """Looks at the middle from above, from the free side."""
    middle = np.mean(np.array(topic.segment), axis=0)
    place = middle + np.array([_BACK * topic.towards[0], _BACK * topic.towards[1], _UP])
    ahead = (middle - place) / np.linalg.norm(middle - place)
    up = np.array([0.0, 0.0, 1.0]) - ahead[2] * ahead
    camera = SubElement(root, "PerspectiveCamera")
    _vector(camera, "CameraViewPoint", place)
    _vector(camera, "CameraDirection", ahead)
    _vector(camera, "CameraUpVector", up / np.linalg.norm(up))
    SubElement(camera, "FieldOfView").text = "60"
    return camera


def _vector(parent: Element, name: str, xyz: NDArray[np.float64]) -> None:
    element = SubElement(parent, name)
    for axis, value in zip("XYZ", xyz.tolist(), strict=True):
        SubElement(element, axis).text = f"{value:.6f}"
