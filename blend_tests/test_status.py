"""Words of the panel about a shot."""

import pytest
import relume

from addon.core import status, words
from addon.core.eta import Eta, EtaEstimator
from addon.core.phase import ShotPhase
from addon.core.shot_status import ShotStatus
from addon.ui.panel import lines
from addon.viewport.side_bar import elided

OWN = {"error", "samples_total", "stage", "remaining", "is_incomplete", "is_under_another_world"}


def state(phase=ShotPhase.PREPARING, **changes):
    """A status with fields of its own and of the native module."""
    own = {name: value for name, value in changes.items() if name in OWN}
    live = relume.LiveStatus(**{name: value for name, value in changes.items() if name not in OWN})
    return ShotStatus(live, ShotPhase(phase), **own)


def stage(name, done=1, total=4, remaining_s=65.0, elapsed_s=1.0):
    times = {"elapsed_s": elapsed_s, "remaining_s": remaining_s}
    return {"stage": name, "done": done, "total": total, **times, "message": ""}


SAYINGS = [
    (state("reading"), "Reading the scene"),
    (state("unread"), "Stopped"),
    (state("unread", error="no camera is set"), "no camera is set"),
    (state("preparing"), "Reading the scene"),
    (state("baking", stage=stage("trace"), samples=3, samples_total=64), "Tracing paths, 3 of 64 samples"),
    (state("baking", stage=stage("prepare"), samples_total=64), "Preparing the scene, 0 of 64 samples"),
    (state("training", stage=stage("references")), "Making pictures to compare with"),
    (state("training", stage=stage("measure")), "Measuring what was learned"),
    (state("training", paused=True), "Paused: Learning the lights"),
    (state("ready", samples=64), "Ready, 64 samples"),
    (state("ready", samples=3, samples_total=8), "Stopped at 3 of 8 samples; they are kept"),
    (
        state("ready", samples=64, samples_total=64, is_incomplete=True),
        "Stopped while learning the lights; 64 samples are kept",
    ),
    (state("cancelled"), "Stopped"),
    (state("cancelled", samples=3, samples_total=8), "Stopped at 3 of 8 samples; they are kept"),
    (
        state("ready", samples=3, samples_total=8, is_under_another_world=True),
        "Stopped at 3 of 8 samples; they are kept, but Resume traces them anew, as the world has changed since. "
        "What was learned stays",
    ),
    (state("failed", error="The disk is full"), "The disk is full"),
    (
        state("failed", error='cannot write: No space left on device (os error 28) at path "/bake/.tmp"'),
        "The disk is full: free some space, or choose another bake folder, and Rebake",
    ),
    (state("failed"), "Relume failed without saying why"),
]


@pytest.mark.parametrize("told, said", SAYINGS)
def test_headline(told, said):
    assert status.headline(told) == said


def picture(scale=1, samples=12, denoised=False, **makers):
    common = {"serial": 1, "request": 1, "scale": scale, "samples": samples, "settled": True}
    return common | {"makers": makers, "denoised": denoised}


PROXIES = {"sphere": {"psnr": 31.0, "smape": 0.08, "gather_smape": 0.05}}
SEVERAL = PROXIES | {"quad": {"psnr": 35.0, "smape": 0.03, "gather_smape": 0.02}}
SHOWN = [
    (state(), ""),
    (state(shown=picture(Key="gather")), "Showing 12 samples"),
    (state(shown=picture(samples=1, denoised=True, Key="gather_denoised")), "Showing 1 sample, denoised"),
    (state(shown=picture(scale=2, Key="gather")), "Showing 12 samples, at 1/2 size"),
    (state(shown=picture(Key="proxy"), proxies=PROXIES), "Showing the proxy (error 8.0 %)"),
    (state(shown=picture(Key="proxy"), proxies=SEVERAL), "Showing the proxy (error up to 8.0 %)"),
    (
        state(shown=picture(denoised=True, Key="proxy", Rim="gather_denoised"), proxies=PROXIES),
        "Showing the proxy (error 8.0 %) and 12 samples, denoised",
    ),
    (state(shown=picture()), "Showing 12 samples"),
    (state(shown=picture(denoised=True)), "Showing 12 samples, denoised"),
    (state(shown=picture(Key="gather") | {"noise": 0.042}), "Showing 12 samples (noise 4 %)"),
    (
        state(shown=picture(denoised=True, Key="gather_denoised") | {"noise": 0.042}),
        "Showing 12 samples, denoised (noise 4 % before)",
    ),
    (state(shown=picture(Key="gather") | {"noise": None}), "Showing 12 samples"),
    (state(shown=picture(Key="gather") | {"noise": 0.0}, rarely_met=["Key"]), "Showing 12 samples"),
]


@pytest.mark.parametrize("told, said", SHOWN)
def test_shown(told, said):
    assert status.shown(told) == said


def test_lights_out_of_sight_are_named_as_long_as_they_are_few():
    assert status.out_of_sight(state("ready", rarely_met=["Key"])) == ["Few paths meet 'Key' where it is now"]
    many = [f"Lamp {number}" for number in range(198)]
    assert status.out_of_sight(state("ready", rarely_met=many)) == [
        "Few paths meet 'Lamp 0', 'Lamp 1', 'Lamp 2' and 195 more where they are now"
    ]
    assert status.out_of_sight(state("ready", rarely_met=["Key", "Rim"])) == [
        "Few paths meet 'Key' and 'Rim' where they are now"
    ]
    assert status.out_of_sight(state("baking", rarely_met=many)) == []


FEW = "its direct light is found by one path in {} pixels and will be noise; make it larger, or bake more samples"
NOTES = [
    ([], []),
    (["the file is old", "the file is old"], ["the file is old"]),
    ([f"light 'Key': {FEW.format(12)}"], [f"light 'Key': {FEW.format(12)}"]),
    (
        [f"light 'Key': {FEW.format(12)}", "the file is old", f"light 'Rim': {FEW.format(12)}"],
        [f"light 'Key', and likewise 'Rim': {FEW.format(12)}", "the file is old"],
    ),
    (
        [f"light 'L{number}': {FEW.format(number)}" for number in (90, 12, 110, 9, 10)],
        [f"light 'L90', and likewise 'L12', 'L110', 'L9' and 1 more: {FEW.format('9 to 110')}"],
    ),
    (
        ["light 'Bob's lamp' is hidden", "light 'Key' is hidden", "object 'Key' is hidden"],
        ["light 'Bob's lamp', and likewise 'Key', is hidden", "object 'Key' is hidden"],
    ),
    (
        ["light 'Key': its node 'Glow 1' is odd", "light 'Rim': its node 'Glow 2' is odd"],
        ["light 'Key': its node 'Glow 1' is odd", "light 'Rim': its node 'Glow 2' is odd"],
    ),
]


@pytest.mark.parametrize("notes, said", NOTES)
def test_what_is_said_of_several_lights_alike_is_said_once(notes, said):
    assert list(words.grouped(tuple(notes))) == said


def test_progress_is_of_running_work_only():
    assert status.progress(state("baking", stage=stage("trace"))) == (0.25, "25 %, 1:05 left")
    assert status.progress(state("baking", stage=stage("trace", remaining_s=None))) == (0.25, "25 %")
    assert status.progress(state("baking", stage=stage("trace", 9, 0))) == (1.0, "100 %, 1:05 left")
    assert status.progress(state("ready", stage=stage("trace"))) is None
    assert status.progress(state("baking")) is None


TO_COME = [
    (state("baking", remaining=Eta(185.0, False, True)), "At least 3:05 until all is traced and learned"),
    (state("training", remaining=Eta(185.0, True, True)), "About 3:05 until all is traced and learned"),
    (state("training", remaining=Eta(65.0, True, False)), "About 1:05 until all is learned"),
    (state("cancelled", remaining=Eta(65.0, True, False)), ""),
    (state("baking"), ""),
]


@pytest.mark.parametrize("told, said", TO_COME)
def test_how_long_all_that_is_left_will_take_is_said(told, said):
    assert status.to_come(told) == said


def working(name, samples, to_learn, **stage_values):
    return state(stage=stage(name, **stage_values), samples=samples, samples_total=64, to_learn=to_learn)


def test_all_that_is_left_is_told_by_the_paces_so_far():
    eta, of_stage = EtaEstimator(60.0), []

    def told(*values, **stage_values):
        told = working(*values, **stage_values)
        eta.note(told)
        of_stage.append(eta.stage_remaining(told))
        return eta.remaining(told)

    assert told("prepare", 0, [16, 64], remaining_s=None) is None
    assert told("trace", 0, [16, 64], done=0, remaining_s=None) is None
    # A second for each of 64 samples; of 16 samples and of all of them a minute each, and what nobody knows yet.
    assert told("trace", 16, [16, 64], done=1600, total=6400, remaining_s=48.0) == (168.0, False, True)
    # Five seconds of pictures to compare with, three of comparing and four of measuring; more of the first and last
    # with more samples.
    assert told("references", 16, [16, 64], remaining_s=4.0) == (4.0 + 60.0 + 5.0 + 60.0 + 48.0, False, True)
    begun = {"done": 10, "total": 100, "remaining_s": 54.0, "elapsed_s": 6.0}
    assert told("train", 16, [16, 64], **begun) == (54.0 + 5.0 + 60.0 + 48.0, False, True)
    compared = {"done": 50, "total": 100, "remaining_s": 31.5, "elapsed_s": 31.5}
    assert told("train", 16, [16, 64], **compared) == (31.5 + 5.0 + 63.0 + 48.0, False, True)
    assert told("measure", 16, [16, 64], remaining_s=3.0) == (3.0 + 72.0 + 48.0, False, True)
    assert told("measure", 16, [16, 16], remaining_s=3.0) == (3.0 + 72.0 + 48.0, True, True)
    assert told("trace", 32, [64], done=3200, total=6400, remaining_s=32.0) == (32.0 + 72.0, False, True)
    assert told("references", 16, [16], remaining_s=4.0) == (4.0 + 63.0 + 4.0 + 48.0, True, True)
    assert told("train", 16, [16], **begun) == (54.0 + 3.0 + 4.0 + 48.0, True, True)
    assert told("train", 64, [64, 64], **compared) == (31.5 + 4.0 + 5.0 + 63.0 + 4.0, False, False)
    assert told("measure", 64, [64], remaining_s=10.0) is None, "nothing follows"
    assert told("measure", 16, [64], done=4, remaining_s=0.0) is None, (
        "what was measured may be out of the list already"
    )
    # The time of learning alone is not told before it is known how long comparing takes.
    assert of_stage == [None, None, 48.0, 4.0, None, 31.5, 3.0, 3.0, 32.0, 4.0, 54.0 + 3.0, 31.5, 10.0, 0.0]


def test_what_was_not_seen_to_be_traced_has_no_pace():
    eta = EtaEstimator(60.0)
    told = working("measure", 16, [16], remaining_s=3.0)
    eta.note(told)
    assert eta.remaining(told) == (3.0, False, True), "in a bake that was opened again"


def test_long_messages_are_broken_between_words():
    assert lines("the quick brown fox", 9) == ["the quick", "brown fox"]
    assert lines("long/path/of/a/file", 10) == ["long/path/", "of/a/file"]
    assert lines("", 5) == [""]
    assert lines("changed by 0.8 %, reached", 14) == ["changed by", "0.8 %, reached"]


def test_long_names_keep_their_ends():
    assert elided("Ceiling Spot 02", 1000.0) == "Ceiling Spot 02"
    short = elided("Ceiling Spot 02", 75.0)
    assert short.startswith("Ceil") and short.endswith("02") and "…" in short
    assert elided("Ceiling Spot 02", 1.0) == "Ceiling Spot 02", "nothing fits"
    assert elided("", 10.0) == ""


KINDS = [
    (["the file is old"], [("the file is old", ())]),
    (
        ["image 'a.png' is missing", "image 'b.png' is missing", "image 'a.png' is missing"],
        [("2 images are missing", ("a.png", "b.png"))],
    ),
    (
        [
            "object 'Fur', material 'Hair': node 'Hair BSDF' is not supported yet",
            "light 'Key': hidden",
            "object 'Cat', material 'Hair.001': node 'Hair' is not supported yet",
        ],
        [
            ("2 objects: node is not supported yet", ("Fur, Hair, Hair BSDF", "Cat, Hair.001, Hair")),
            ("light 'Key': hidden", ()),
        ],
    ),
]


@pytest.mark.parametrize("warnings, kinds", KINDS)
def test_warnings_of_a_kind_have_one_title(warnings, kinds):
    assert [tuple(kind) for kind in words.by_kind(tuple(warnings))] == kinds
