"""Takes set aside as test beside the collection's own split: neither weights nor the second classifier ever see
them; the first one is older."""

from __future__ import annotations

SPLIT = "held out"
"""Split of those takes, whatever the collection says; its own "test" stays as it is, so that old figures compare."""

TAKES = {
    ("cmu", "14_28"): "sits down on a high stool and stands up, twice",
    ("cmu", "14_31"): "sits down on a low stool and stands up, twice",
    ("cmu", "13_36"): "climbs three steps and comes down",
    (
        "cmu",
        "14_23",
    ): "climbs three steps and comes down, by the performer of 14_21, which the collection keeps for test",
    ("cmu", "16_34"): "walks slowly and stops",
    ("cmu", "91_04"): "stands, starts to walk, walks, stops",
    ("snu", "snu_w2_walk_normal_left_90"): "stands, walks, turns, stops: five times with two seconds of rest between",
    ("snu", "snu_w2_walk_normal_right_135"): "stands, walks, turns, stops: five times with two seconds of rest between",
    ("snu", "snu_w2_walk_normal_style_1"): "turns in place six times between walks",
}
"""Source and id of each, and what it is kept for: to stand, stop, start, turn, sit, stand up and climb.

Of the few takes in which someone sits or climbs, two each; of those with rests, 3 of the 21 of SNU's one performer and
2 of CMU's. Picking up and putting down have test takes in the collection (HDM05's performer tr).
"""
