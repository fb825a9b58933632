"""Imports run one way: no circle of modules, none of rooms; and the drawing of them is that of the code."""

from workflow import structure


def test_no_circle_of_modules_or_rooms():
    edges = structure.modules()
    assert len(structure.order(edges)) == len(edges) > 150
    rooms = structure.rooms(edges)
    assert {"optics.modal", "dynamics.membrane", "workflow.figures"} <= set(structure.order(rooms))


def test_reduced_edges_lead_wherever_all_did():
    edges = {"a": {"b", "c"}, "b": {"c"}, "c": set()}
    assert structure.reduced(edges) == {"a": {"b"}, "b": {"c"}, "c": set()}


def test_the_drawing_is_that_of_the_code():
    assert structure.FILE.read_text(encoding="utf-8") == structure.drawn(), "python -m workflow.structure draws it anew"
