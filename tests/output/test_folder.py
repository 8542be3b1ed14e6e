from pathlib import Path

import pytest

from lookonce.errors import OutputError
from lookonce.output import prepare_output_folder

FILES = ("tracks.jsonl", "tracks.txt")


def test_folder_is_created_with_its_parents(tmp_path):
    prepare_output_folder(tmp_path / "a" / "b", FILES, overwrite=False)
    assert list((tmp_path / "a" / "b").iterdir()) == []


def test_other_files_do_not_matter(tmp_path):
    (tmp_path / "notes.md").write_text("mine")
    prepare_output_folder(tmp_path, FILES, overwrite=False)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.md"]


def test_earlier_result_is_refused_in_one_line_with_remedy(tmp_path):
    (tmp_path / "tracks.txt").write_text("earlier")
    with pytest.raises(OutputError) as caught:
        prepare_output_folder(tmp_path, FILES, overwrite=False)
    assert str(caught.value) == (
        f"{tmp_path}/tracks.txt exists from an earlier run; give --overwrite to replace it "
        "or choose another folder with -o"
    )
    assert (tmp_path / "tracks.txt").read_text() == "earlier"


def test_overwrite_removes_exactly_the_named_files(tmp_path):
    for name in (*FILES, "tracks.mp4"):
        (tmp_path / name).write_text("earlier")
    prepare_output_folder(tmp_path, FILES, overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["tracks.mp4"]


def test_dangling_link_counts_as_earlier_result(tmp_path):
    (tmp_path / "tracks.txt").symlink_to(tmp_path / "gone")
    with pytest.raises(OutputError, match="exists from an earlier run"):
        prepare_output_folder(tmp_path, FILES, overwrite=False)


def test_folder_in_the_place_of_a_result_is_not_removed(tmp_path):
    (tmp_path / "tracks.txt").mkdir()
    with pytest.raises(OutputError, match=r"tracks\.txt: cannot be replaced"):
        prepare_output_folder(tmp_path, FILES, overwrite=True)


@pytest.mark.parametrize("below", [pytest.param("", id="itself"), pytest.param("deep/er", id="a parent")])
def test_file_in_the_place_of_a_folder_is_named(tmp_path, below):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be created") as caught:
        prepare_output_folder(tmp_path / "file" / below, FILES, overwrite=True)
    assert "\n" not in str(caught.value)


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc on this system")
@pytest.mark.parametrize(
    ("folder", "message"),
    [
        pytest.param("/proc/self", "/proc/self: cannot be written", id="exists"),
        pytest.param("/proc/results/run", "/proc/results/run: cannot be created", id="new"),
    ],
)
def test_folder_that_takes_no_files_is_refused(folder, message):
    with pytest.raises(OutputError, match=message):
        prepare_output_folder(Path(folder), FILES, overwrite=False)
