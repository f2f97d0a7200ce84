"""The Blender in the background that does what is soon done, and how its jobs get along."""

import threading
import time
from pathlib import Path

import numpy as np
import pytest

from addon.engine.workers import helper, view_worker
from addon.engine.workers.view_worker import ViewWorker, file_of, tables_of
from addon.export.color_table import COARSE, FINE
from addon.export.view_transform import view_settings

SECONDS = 120.0


class Stage:
    """The other Blender's side played by this one, for as long as there is a job."""

    def __init__(self, folder, monkeypatch):
        monkeypatch.setattr(helper, "private_folder", lambda: Folder(folder))
        monkeypatch.setattr(helper, "IDLE_SECONDS", 0.05)
        monkeypatch.setattr(helper, "Worker", Idle)
        monkeypatch.setattr(helper, "blender_command", lambda *_: [])
        self.helper = helper.Helper()
        self.place = folder
        self.told = []

    def serve(self, **works):
        helper.serve(self.place, self.told.append, works)


class Folder:
    def __init__(self, path):
        self.name = str(path)

    def cleanup(self):
        """Left to the test."""


class Idle:
    """A process that does nothing."""

    ended = False

    def __init__(self, *_):
        """Starts nothing."""

    def events(self):
        return []


@pytest.fixture
def stage(tmp_path, monkeypatch):
    return Stage(tmp_path, monkeypatch)


def test_what_is_urgent_is_done_between_the_pieces_of_what_is_not(stage):
    done = []

    def long(_prefix, job):
        for piece in range(3):
            done.append(job + piece)
            if piece == 0:
                stage.helper.begin("urgent", 20)
            yield {}

    def urgent(_prefix, job):
        done.append(job)
        yield {"got": job}

    first = stage.helper.begin("long", 10)
    stage.serve(urgent=urgent, long=long)
    assert done == [10, 20, 11, 12]
    assert stage.told == [
        {"got": 20, "number": first + 1},
        {"finished": True, "number": first + 1},
        {"finished": True, "number": first},
    ]
    assert not list(stage.place.iterdir())


def test_a_job_that_is_dropped_goes_no_further_and_leaves_no_file(stage):
    done = []

    def work(prefix, job):
        done.append(job)
        Path(f"{prefix}half").touch()
        if job == "dropped":
            stage.helper.drop(number)
        yield {}
        done.append("more")

    number = stage.helper.begin("any", "dropped")
    stage.serve(any=work)
    assert done == ["dropped"] and not list(stage.place.iterdir())
    with pytest.raises(OSError, match="ended"):
        stage.helper.take(number)
    stage.helper.begin("any", "kept")
    stage.serve(any=work)
    assert done == ["dropped", "kept", "more"]


def test_what_fails_is_told_and_the_next_job_is_done(stage):
    def work(_prefix, job):
        if job == "bad":
            raise ValueError("no such thing")
        yield {}

    bad, good = stage.helper.begin("any", "bad"), stage.helper.begin("any", "good")
    stage.serve(any=work)
    assert stage.told == [{"failed": "no such thing", "number": bad}, {"finished": True, "number": good}]


def test_jobs_of_threads_have_numbers_of_their_own(stage):
    numbers, arrays = [], np.arange(1000)
    threads = [
        threading.Thread(target=lambda: numbers.extend(stage.helper.begin("any", arrays) for _ in range(50)))
        for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(numbers) == list(range(1, 201))
    sums = []

    def work(_prefix, job):
        sums.append(job.sum())
        yield {}

    stage.serve(any=work)
    assert sums == [arrays.sum()] * 200


@pytest.fixture
def other():
    yield helper.shared()
    helper.close()


def test_the_others_jobs_outlive_one_that_is_interrupted(scene, other):
    """As where a bake is cancelled while the other Blender is at a mesh, and a view waits for its table."""
    scene.view_settings.view_transform = "AgX"
    worker = ViewWorker()
    job = tables_of(view_settings(scene))
    worker.ask(job)
    interrupted = other.begin(view_worker.KIND, job)
    process = other._worker._process
    other.interrupt(interrupted)
    lengths, until = [], time.monotonic() + SECONDS
    while not worker.is_finished:
        if (found := worker.turn()) is not None:
            (entries, _), _ = found
            lengths.append(len(entries))
        assert time.monotonic() < until
        time.sleep(0.01)
    assert lengths == [COARSE, FINE]
    assert process.wait(SECONDS) != 0 and other._worker._process is not process


def test_what_is_done_is_interrupted_without_ending_anything(scene, other, tmp_path):
    number = other.begin(view_worker.KIND, file_of(view_settings(scene), tmp_path / "missing" / "view.png", b""))
    until = time.monotonic() + SECONDS
    with pytest.raises(OSError, match="missing"):
        while time.monotonic() < until:
            other.take(number)
            time.sleep(0.01)
    other.interrupt(number)
    assert other.is_running
