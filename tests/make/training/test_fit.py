"""From squares to a model file that tells them apart: the whole of a fit, interrupted and not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import onnx
import pytest
import torch
from PIL import Image

from datasets.making import refusal
from lookonce.datasets import open_sequences, open_stills
from lookonce.errors import ConfigError, FormatError, ModelError
from lookonce.make.darknet.importer import import_darknet
from lookonce.make.training import readings as readings_module
from lookonce.make.training.config import FitConfig
from lookonce.make.training.fit import FitData, _sources
from lookonce.model import Model, describe_model
from lookonce.model.metadata import METADATA_KEY
from make.training.scenes import Watcher, run_fit, write_labelled, write_resting_clip, write_stills
from squares import picture, write_darknet

CONFIG = FitConfig(steps=12, check_every=4, identities=16, views=2, collages=2, variants=1, sequence_frames=50)
KINDS = ["compact", "paper"]


@pytest.fixture(autouse=True)
def _small_chunks(monkeypatch):
    monkeypatch.setattr(readings_module, "CHUNK_TASKS", 16)


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> FitData:
    folder = tmp_path_factory.mktemp("data")
    return FitData(
        open_sequences(write_labelled(folder / "walk")),
        (open_stills(write_stills(folder / "stills")), open_stills(write_stills(folder / "bare", labels=False))),
        (write_resting_clip(folder / "rest.mp4"),),
    )


def run(model, data, output, config=CONFIG, **options):
    output.with_suffix(".fit").mkdir(exist_ok=True)
    return run_fit(model, data, output, config, **options)


@pytest.mark.parametrize("kind", KINDS)
def test_a_fit_gives_descriptors_and_leaves_detections_as_they_are(square_model, data, tmp_path, kind):
    config = replace(CONFIG, kind=kind)
    watcher = Watcher()
    result = run(square_model, data, tmp_path / "out.onnx", config, watcher=watcher)
    before, after = Model(square_model, threads=1), Model(tmp_path / "out.onnx", threads=1)
    for index in range(4):
        old, new = before.detect(picture(index)), after.detect(picture(index))
        for name in ("xyxy", "scores", "labels"):
            assert getattr(new, name).tobytes() == getattr(old, name).tobytes()
        assert new.descriptors.shape == (3, 128)
        assert np.linalg.norm(new.descriptors, axis=1) == pytest.approx(1, abs=1e-4)
    metadata = describe_model(tmp_path / "out.onnx")
    assert metadata == result.metadata
    assert metadata.descriptor.kind == kind
    assert metadata.descriptor.size == 128
    assert set(metadata.descriptor.layers) <= {"layer_0", "layer_1"}
    assert 0 < metadata.descriptor.match_threshold < 2
    assert metadata.training["data"] == "walk, stills, bare, rest.mp4"
    assert f"kind={kind}" in metadata.training["settings"]
    assert "held out" in metadata.training["validation"]
    assert metadata.names == describe_model(square_model).names
    assert result.rows > 100
    assert result.history.step == [4, 8, 12]
    assert {stage[0] for stage in watcher.stages} == {"link rest.mp4", "detect in bare", "read features", "train"}


def test_training_tells_the_squares_apart(square_model, data, tmp_path):
    """Two squares of one class differ in colour only; the detector's own features are of no help here."""
    run(square_model, data, tmp_path / "out.onnx", replace(CONFIG, steps=60, check_every=20, learning_rate=1e-2))
    model = Model(tmp_path / "out.onnx", threads=1)
    looks = {}
    for index in (0, 2, 4):
        found = model.detect(picture(index))
        for row in found.xyxy[:, 1].argsort():
            looks.setdefault(int(found.xyxy[row, 1]), []).append(found.descriptors[row])
    green, blue = (np.array(looks[top]) for top in (24, 48))
    same = np.linalg.norm(green[:, None] - green, axis=2).max()
    other = np.linalg.norm(green[:, None] - blue, axis=2).min()
    assert same < other


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_seed_gives_the_same_model_file(square_model, data, tmp_path, kind):
    config = replace(CONFIG, kind=kind, steps=6, check_every=3)
    files = []
    for name, seed, threads in (("a", 0, 1), ("b", 0, 1), ("c", 1, 1)):
        run(square_model, data, tmp_path / f"{name}.onnx", replace(config, seed=seed), threads=threads)
        files.append((tmp_path / f"{name}.onnx").read_bytes())
    assert files[0] == files[1]
    assert files[0] != files[2]


@pytest.mark.parametrize(
    ("stage", "after"),
    [
        pytest.param("link rest.mp4", 5, id="in linking"),
        pytest.param("read features", 2, id="in the features"),
        pytest.param("train", 2, id="before the first look"),
        pytest.param("train", 9, id="in training"),
        pytest.param("train", 12, id="at the last step"),
    ],
)
def test_an_interrupted_fit_gives_the_same_model_file(square_model, data, tmp_path, stage, after):
    run(square_model, data, tmp_path / "whole.onnx")
    with pytest.raises(KeyboardInterrupt):
        run(square_model, data, tmp_path / "cut.onnx", watcher=Watcher(stage, after))
    assert not (tmp_path / "cut.onnx").exists()
    run(square_model, data, tmp_path / "cut.onnx")
    assert (tmp_path / "cut.onnx").read_bytes() == (tmp_path / "whole.onnx").read_bytes()


def test_a_fitted_file_can_be_fitted_again(square_model, data, tmp_path):
    """The first head is taken off, and has no influence on the second."""
    run(square_model, data, tmp_path / "first.onnx", replace(CONFIG, kind="paper", steps=2, check_every=1))
    run(square_model, data, tmp_path / "direct.onnx")
    run(tmp_path / "first.onnx", data, tmp_path / "second.onnx")
    direct, second = (Model(tmp_path / f"{name}.onnx", threads=1) for name in ("direct", "second"))
    assert second.metadata == direct.metadata
    expected, found = direct.detect(picture(3)), second.detect(picture(3))
    assert found.xyxy.tobytes() == expected.xyxy.tobytes()
    assert found.descriptors == pytest.approx(expected.descriptors, abs=1e-6)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["sequences", "stills", "bare stills", "videos"])
def test_each_kind_of_data_is_enough(square_model, data, tmp_path, kind, seed):
    """Chance may not hold out what cannot be compared, such as tracks that were never there at once."""
    extra = "".join(f"{frame},{n},{8 * n},56,8,8,1,-1,-1,-1\n" for frame in (1, 2, 3) for n in range(4, 7))
    part = {
        "sequences": lambda: FitData(open_sequences(write_labelled(tmp_path / "walk", extra_rows=extra))),
        "stills": lambda: FitData(stills=data.stills[:1]),
        "bare stills": lambda: FitData(stills=data.stills[1:]),
        "videos": lambda: FitData(videos=data.videos),
    }[kind]()
    result = run(square_model, part, tmp_path / "out.onnx", replace(CONFIG, steps=1, seed=seed))
    assert result.validation.identities >= 2
    assert result.identities >= 2


def test_tracks_of_a_video_are_held_out_around_one_moment(square_model, data):
    for seed in range(5):
        config = replace(CONFIG, seed=seed, held_out=0.25)
        (source,) = _sources(
            square_model, describe_model(square_model), replace(data, sequences=(), stills=()), config, 1, Watcher()
        )
        assert source.held_out.sum() == 3
        assert len(np.unique(source.lifetimes[source.held_out], axis=0)) == 1


def test_too_few_identities_are_one_line(square_model, data, tmp_path):
    watcher = Watcher()
    few = FitData(data.sequences)
    message = refusal(ConfigError, lambda: run(square_model, few, tmp_path / "none.onnx", watcher=watcher))
    assert "walk: 3 identities in all, expected at least 4" in message
    assert not watcher.stages
    message = refusal(ConfigError, lambda: run(square_model, FitData(), tmp_path / "none.onnx"))
    assert "nothing to learn from" in message


def test_findings_are_told(square_model, data, tmp_path):
    watcher = Watcher()
    run(square_model, data, tmp_path / "out.onnx", replace(CONFIG, cache_gb=0.01), watcher=watcher)
    linked, detected, read = watcher.findings
    assert linked == (
        "rest.mp4: 12 tracks of 72 detections in 24 frames; cut 0 times for being ambiguous, "
        "0 detections in tracks that were too short"
    )
    assert detected == "bare: no labels; the detector found 9 objects"
    assert "readings of" in read
    assert "cache_gb" not in read


def test_a_full_cache_is_told(square_model, data, tmp_path, monkeypatch):
    from lookonce.make.training import fit as module

    read = module.read_features
    monkeypatch.setattr(module, "read_features", lambda *a, **k: read(*a, **k | {"limit_bytes": 45_000}))
    watcher = Watcher()
    run(square_model, data, tmp_path / "out.onnx", replace(CONFIG, cache_gb=4), watcher=watcher)
    assert "cache_gb=4 is too small" in watcher.findings[-1]


def test_whole_sequences_are_held_out_where_there_are_many(square_model, tmp_path):
    """So that validation sees places that training never saw."""
    parts = [open_sequences(write_labelled(tmp_path / f"walk{n}", frames=3))[0] for n in range(6)]
    sources = _sources(square_model, describe_model(square_model), FitData(tuple(parts)), CONFIG, 1, Watcher())
    assert sorted(set(source.held_out.tolist()) == {True} for source in sources) == [False] * 5 + [True]


@pytest.mark.parametrize("seed", range(3))
def test_no_sequence_is_held_out_in_which_nothing_can_be_compared(square_model, tmp_path, seed):
    """Of six sequences five have one object: validation would have had nothing to do."""
    parts = []
    for n in range(6):
        folder = write_labelled(tmp_path / f"walk{n}", frames=3)
        if n != 4:
            truth = folder / "gt" / "gt.txt"
            truth.write_text("".join(line for line in truth.read_text().splitlines(True) if line.split(",")[1] == "1"))
        parts += open_sequences(folder)
    config = replace(CONFIG, seed=seed)
    sources = _sources(square_model, describe_model(square_model), FitData(tuple(parts)), config, 1, Watcher())
    assert [source.name for source in sources if source.held_out.any()] == ["walk4"]


def test_some_identities_of_a_single_sequence_are_held_out(square_model, tmp_path):
    extra = "".join(f"{frame},{n},{8 * n},56,8,8,1,-1,-1,-1\n" for frame in (1, 2) for n in range(4, 8))
    parts = open_sequences(write_labelled(tmp_path / "walk", frames=3, extra_rows=extra))
    sources = _sources(square_model, describe_model(square_model), FitData(parts), CONFIG, 1, Watcher())
    assert sources[0].held_out.sum() == 2


def test_boxes_of_stills_that_the_detector_finds_are_those_of_the_file(square_model, tmp_path):
    """Large pictures are shrunk on opening; what is found there is scaled back."""
    folder = write_stills(tmp_path / "large", (0, 3), labels=False)
    for path in (folder / "images").iterdir():
        with Image.open(path) as small:
            large = small.resize((640, 640), Image.Resampling.NEAREST)
        large.save(path)
    sources = _sources(
        square_model, describe_model(square_model), FitData(stills=(open_stills(folder),)), CONFIG, 1, Watcher()
    )
    found = np.array([o.box for o in sources[0]._objects[:6]])
    assert np.abs(found[:, 2:] - found[:, :2] - 80).max() < 5
    assert sorted(set((found[:, 1] / 80).round().astype(int).tolist())) == [1, 3, 6]


def test_a_damaged_still_is_one_line(square_model, tmp_path):
    for labels in (True, False):
        folder = write_stills(tmp_path / f"set{labels}", (0, 3, 5), labels=labels)
        stills = open_stills(folder)
        path = folder / "images" / "3.png"
        path.write_bytes(path.read_bytes()[:90])
        data = FitData(stills=(stills,))
        message = refusal(FormatError, lambda data=data: run(square_model, data, tmp_path / "out.onnx"))
        assert "3.png" in message


def without_features(model, path):
    """The model file as somebody else could have written it: nothing that descriptors could read is named."""
    import json

    proto = onnx.load(model)
    for prop in proto.metadata_props:
        if prop.key == METADATA_KEY:
            prop.value = json.dumps(json.loads(prop.value) | {"features": [], "descriptor": None})
    onnx.save(proto, path)
    return path


def test_a_model_file_that_names_no_features_is_refused_at_once(square_model, data, tmp_path):
    model = without_features(square_model, tmp_path / "foreign.onnx")
    watcher = Watcher()
    for kind in KINDS:
        config = replace(CONFIG, kind=kind)
        message = refusal(ModelError, lambda c=config: run(model, data, tmp_path / "out.onnx", c, watcher=watcher))
        assert "foreign.onnx" in message
        assert "lookonce import" in message
    assert not watcher.stages


@pytest.mark.parametrize("device", ["cuda", "abacus"])
def test_a_device_that_is_not_there_is_refused_at_once(square_model, data, tmp_path, device, monkeypatch):
    from lookonce.make.training.fit import fit

    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    watcher = Watcher()
    message = refusal(
        ConfigError,
        lambda: fit(square_model, data, tmp_path / "o.onnx", CONFIG, folder=tmp_path, device=device, progress=watcher),
    )
    assert f"'{device}'" in message
    assert not watcher.stages


def test_threads_and_random_numbers_of_pytorch_are_put_back(square_model, data, tmp_path):
    threads, state = torch.get_num_threads(), torch.get_rng_state()
    run(square_model, data, tmp_path / "out.onnx", replace(CONFIG, steps=1), threads=threads + 1)
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.get_rng_state(), state)


def test_names_that_no_model_file_may_hold_are_made_printable(square_model, data, tmp_path):
    """A line break in the name of a video made a model file that could not be opened again."""
    clip = tmp_path / "two\nlines.mp4"
    clip.write_bytes(data.videos[0].read_bytes())
    run(square_model, replace(data, videos=(clip,)), tmp_path / "out.onnx", replace(CONFIG, steps=1))
    assert "two\\nlines.mp4" in describe_model(tmp_path / "out.onnx").training["data"]


@pytest.fixture(scope="module")
def person_model(tmp_path_factory):
    """A detector that calls its squares persons and boats."""
    folder = tmp_path_factory.mktemp("persons")
    cfg, weights, names = write_darknet(folder)
    names.write_text("person\nboat\n")
    import_darknet(cfg, weights, folder / "persons.onnx", names=names)
    return folder / "persons.onnx"


def test_a_detector_that_knows_persons_learns_from_rendered_ones_too(person_model, data, tmp_path, monkeypatch):
    """They are trained on, and the real ones judge; with two workers they are drawn as with one."""
    monkeypatch.setattr(torch, "set_num_threads", lambda _: None)  # sums of the training itself may depend on threads
    results = {}
    for crowds in (0, 1):
        output = tmp_path / f"{crowds}.onnx"
        results[crowds] = run(person_model, data, output, replace(CONFIG, crowds=crowds))
    assert results[1].identities > results[0].identities + 5
    assert results[1].identities <= results[0].identities + 28
    assert results[1].validation.identities == results[0].validation.identities
    assert "crowds=1" in results[1].metadata.training["settings"]
    again = run(person_model, data, tmp_path / "again.onnx", replace(CONFIG, crowds=1), threads=2)
    assert again.metadata == results[1].metadata
    assert (tmp_path / "again.onnx").read_bytes() == (tmp_path / "1.onnx").read_bytes()


def test_rendered_identities_do_not_stand_in_for_real_ones(person_model, tmp_path):
    lone = FitData(stills=(open_stills(write_stills(tmp_path / "one", (0,))),))
    message = refusal(ConfigError, lambda: run(person_model, lone, tmp_path / "out.onnx"))
    assert "give more data" in message
