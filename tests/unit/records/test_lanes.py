"""Lanes in pieces and their centre lines, and OpenDRIVE maps: against geometry in closed form."""

import numpy as np
import pytest
from accelerated_evaluation.base.errors import InputError
from accelerated_evaluation.records.recordings.centre_lines import CentreLines, Piece, joined_lanes
from accelerated_evaluation.records.recordings.osi_lanes import lanes_of_map
from scipy.special import fresnel


def piece(number, before=(), after=(), line=()):
    return Piece(number, np.reshape(line, (-1, 2)).astype(float), frozenset(before), frozenset(after))


def test_pieces_are_one_lane_where_nothing_splits_or_merges():
    chain = [piece(3, after=[1]), piece(1, before=[3], after=[2]), piece(2, before=[1], after=[5, 6])]
    split = [piece(5, before=[2], after=[7]), piece(6, before=[2])]
    turned = [piece(7, after=[5])]  # drawn against the direction of its neighbour
    assert joined_lanes([*chain, *split, *turned]) == {1: 1, 2: 1, 3: 1, 5: 5, 7: 5, 6: 6}
    assert joined_lanes([piece(4)]) == {4: 4}


@pytest.mark.parametrize("reverse", [False, True])
def test_a_claim_of_one_side_counts_where_the_centre_lines_meet(reverse):
    def one(start, end, number, **claims):
        line = [(start, 0), (end, 0)]
        names = {"before": "after", "after": "before"} if reverse else {}
        return piece(
            number, line=line[::-1] if reverse else line, **{names.get(k, k): v for k, v in claims.items()}
        )

    first = one(0, 100, 1)
    assert joined_lanes([first, one(100.9, 200, 2, before=[1])]) == {1: 1, 2: 1}
    assert joined_lanes([first, one(101.1, 200, 2, before=[1])]) == {1: 1, 2: 2}
    assert joined_lanes([first, one(100, 200, 2)]) == {1: 1, 2: 2}  # nobody claims
    ramp = one(100, 200, 3, before=[1])  # a second piece that continues the first
    assert joined_lanes([first, one(100, 200, 2, before=[1]), ramp]) == {1: 1, 2: 2, 3: 3}
    loop = [one(0, 100, 1, before=[1], after=[1])]  # a piece that names itself
    assert joined_lanes(loop) == {1: 1}


def test_a_vehicle_is_in_the_lane_whose_marking_it_has_not_crossed():
    line = np.array([(0.0, 0.0), (50.0, 0.0)])
    narrow = Piece(1, line, half_width=np.full(2, 1.5))
    wide = Piece(2, line + np.array([0, 4.0]), half_width=np.full(2, 2.5))  # the marking is at y = 1.5
    crossing = Piece(3, np.array([(25.0, -25.0), (25.0, 25.0)]))
    centres = CentreLines([narrow, wide, crossing])
    y = np.array([-1.9, -1.8, 0.0, 1.49, 1.51, 4.0, 7.1, 7.2, np.nan])
    expected = [None, 1, 1, 1, 2, 2, 2, None, None]
    x, yaw = np.full(y.size, 25.0), np.zeros(y.size)
    assert centres.nearest(x, y, yaw) == centres.nearest(x, y, yaw + np.pi) == expected
    assert CentreLines([narrow, wide]).nearest(x, y, yaw + np.pi / 2) == [None] * 9  # none is aligned
    assert centres.nearest(x[:1], np.array([0.3]), yaw[:1] + np.pi / 2) == [3]
    assert centres.nearest(np.array([51.1, 50.9]), np.zeros(2), np.zeros(2)) == [None, 1]  # beyond the end
    # The nearest centre line is the wrong rule where lanes are of different widths.
    equal = [Piece(one.number, one.line) for one in (narrow, wide)]
    assert CentreLines(equal).nearest(x[:1], np.array([1.8]), yaw[:1]) == [1]


def test_pieces_without_a_centre_line_are_left_out():
    assert CentreLines.of([piece(1), piece(2, line=[(1, 1)]), piece(3, line=[(1, 1), (1, 1)])]) is None


# ---------------------------------------------------------------- OpenDRIVE

WIDTH = "<width sOffset='0' a='{}' b='{}' c='0' d='0'/>"


def lane(number, width=(3.5, 0), links="", kind="driving"):
    return f"<lane id='{number}' type='{kind}'>{WIDTH.format(*width)}<link>{links}</link></lane>"


def road(number, curves, sections, length, links="", more=""):
    """Return a road of curves (s, x, y, heading, length, element) and sections (s, right, left)."""
    view = "".join(
        f"<geometry s='{s}' x='{x}' y='{y}' hdg='{h}' length='{size}'>{element}</geometry>"
        for s, x, y, h, size, element in curves
    )
    parts = "".join(
        f"<laneSection s='{s}'><left>{left}</left><center><lane id='0' type='none'/></center>"
        f"<right>{right}</right></laneSection>"
        for s, right, left in sections
    )
    return (
        f"<road id='{number}' length='{length}'><link>{links}</link><planView>{view}</planView>"
        f"<lanes>{more}{parts}</lanes></road>"
    )


def pieces(*content):
    return lanes_of_map(f"<OpenDRIVE xmlns='a'>{''.join(content)}</OpenDRIVE>", "map")


def end_of(element, length, heading=0.0):
    """Return the last point of a lane of no width along a curve that begins at the origin."""
    curves = [(0, 0, 0, heading, length, element)]
    (found,) = pieces(road("a", curves, [(0, lane(-1, (0, 0)), "")], length))
    return found.line[-1]


def test_curves_end_where_their_closed_forms_do():
    assert end_of("<line/>", 50, 0.3) == pytest.approx([50 * np.cos(0.3), 50 * np.sin(0.3)])
    radius, angle = 80.0, 2.0
    arc = end_of(f"<arc curvature='{-1 / radius}'/>", radius * angle)
    assert arc == pytest.approx([radius * np.sin(angle), -radius * (1 - np.cos(angle))], abs=1e-6)
    length, rate = 120.0, 1e-4  # a clothoid whose curvature grows by ``rate`` a metre
    scale = np.sqrt(np.pi / rate)
    sine, cosine = fresnel(length / scale)
    clothoid = end_of(f"<spiral curvStart='0' curvEnd='{rate * length}'/>", length)
    assert clothoid == pytest.approx([scale * cosine, scale * sine], abs=1e-6)
    assert end_of(f"<arc curvature='{rate * length / 2}'/>", length) != pytest.approx(clothoid, abs=1.0)
    powers = {"U": (0, 40, 0, -3), "V": (0, 0, 5, 2)}
    named = " ".join(
        f"{p}{axis}='{v}'" for axis, all_ in powers.items() for p, v in zip("abcd", all_, strict=True)
    )
    assert end_of(f"<paramPoly3 pRange='normalized' {named}/>", 38.0) == pytest.approx([37, 7])
    by_length = end_of(f"<paramPoly3 pRange='arcLength' {named}/>", 2.0)
    assert by_length == pytest.approx([2 * 40 - 3 * 8, 5 * 4 + 2 * 8])


def test_lanes_lie_beside_the_reference_line_at_their_widths_and_offset():
    offset = "<laneOffset s='0' a='0' b='0' c='0' d='0'/><laneOffset s='50' a='1' b='.02' c='0' d='0'/>"
    right = lane(-2, (2, 0.01)) + lane(-1) + lane(-3, kind="border")
    curves = [(0, 0, 0, np.pi / 2, 100, "<line/>")]  # to the north: the right is at positive x
    found = pieces(road("a", curves, [(0, right, lane(1, (3, 0)))], 100, more=offset))
    by_place = {round(one.line[0, 0], 2): one for one in found}
    assert set(by_place) == {1.75, 4.5, -1.5}
    assert by_place[4.5].half_width[[0, -1]] == pytest.approx([1, 1.5])
    assert by_place[4.5].line[-1] == pytest.approx([3.5 + 1.5 - 2, 100])  # the offset moves all to the left
    assert by_place[-1.5].line[-1] == pytest.approx([-1.5 - 2, 100])


def test_lanes_continue_across_sections_roads_and_junctions_and_end_where_they_merge():
    def straight(start, length):
        return [(0, start, 0, 0, length, "<line/>")]

    ahead, back = "<successor id='{}'/>", "<predecessor id='{}'/>"
    first = road(
        "a",
        straight(0, 100),
        [
            (0, lane(-1, links=ahead.format(-1)) + lane(-2, (3.5, -0.05), ahead.format(-1)), ""),
            (70, lane(-1, links=back.format(-1) + ahead.format(1)), ""),
        ],
        100,
        "<successor elementType='road' elementId='b' contactPoint='end'/>",
    )
    # The second road is drawn against the first one, so that its left lane continues the right one.
    second = road(
        "b",
        [(0, 200, 0, np.pi, 100, "<line/>")],
        [(0, "", lane(1, links=back.format(-1) + ahead.format(-1)))],
        100,
        "<predecessor elementType='junction' elementId='j'/>"
        "<successor elementType='road' elementId='a' contactPoint='end'/>",
    )
    third = road(
        "c",
        straight(200, 100),
        [(0, lane(-1), "")],
        100,
        "<predecessor elementType='junction' elementId='j'/>",
    )
    junction = (
        "<junction id='j'><connection incomingRoad='b' linkedRoad='c' contactPoint='start'>"
        "<laneLink from='1' to='-1'/></connection></junction>"
    )
    found = pieces(first, second, third, junction)
    lanes = joined_lanes(found)
    assert [lanes[one.number] for one in found] == [0, 1, 0, 0, 0]  # the lane that ends is another one
    without = joined_lanes(pieces(first, second, third))
    assert len(set(without.values())) == 3


@pytest.mark.parametrize(
    ("content", "seen"),
    [
        ("<road", "ParseError"),
        (road("a", [(0, 0, 0, 0, 9, "<poly3/>")], [(0, lane(-1), "")], 9), "poly3"),
        (road("a", [(0, 0, 0, "x", 9, "<line/>")], [(0, lane(-1), "")], 9), "could not convert"),
        (
            road("a", [(0, 0, 0, 0, 9, "<line/>")], [(0, lane(-1).replace("width", "border"), "")], 9),
            "borders",
        ),
        (road("a", [], [(0, lane(-1), "")], 9), "IndexError"),
        (road("a", [(0, 0, 0, 0, 9, "<line/>")], [(0, lane(-1).replace("a='", "a='-"), "")], 9), "negative"),
    ],
)
def test_maps_that_cannot_be_read_are_refused(content, seen):
    with pytest.raises(InputError, match=f"map: seen .*{seen}.*expected an OpenDRIVE map"):
        pieces(content)
