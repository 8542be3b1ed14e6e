from io import FileIO
from pathlib import Path

import pytest

from lookonce.errors import OutputError
from lookonce.output.append_only import AppendOnlyFile

FULL_DISK = Path("/dev/full")
needs_full_disk = pytest.mark.skipif(not FULL_DISK.exists(), reason="no /dev/full on this system")


class _SmallDisk(FileIO):
    """Takes 10 bytes, then none; the write that hits the limit is taken in part."""

    def write(self, data):
        room = 10 - self.tell()
        if room <= 0:
            raise OSError(28, "No space left on device")
        return super().write(bytes(data)[:room])


@needs_full_disk
def test_full_disk_names_the_file_and_the_file_still_closes():
    file = AppendOnlyFile(FULL_DISK)
    with pytest.raises(OutputError, match=r"/dev/full: cannot be written \(no space left on device\)"):
        file.append(b"record\n")
    with pytest.raises(OutputError, match="/dev/full"):
        file.append(b"another\n")
    file.close()
    file.close()


def test_record_taken_in_part_is_cut_off(tmp_path):
    path = tmp_path / "r.txt"
    file = AppendOnlyFile(path)
    file._file.close()
    file._file = _SmallDisk(path, "w")
    file.append(b"whole 1\n")
    with pytest.raises(OutputError, match="valid up to the record before"):
        file.append(b"whole 2\n")
    assert path.read_bytes() == b"whole 1\n"
    file.close()


def test_write_after_close_is_a_wrong_call(tmp_path):
    file = AppendOnlyFile(tmp_path / "r.txt")
    file.close()
    with pytest.raises(ValueError, match="write after close"):
        file.append(b"x")


def test_existing_file_is_emptied(tmp_path):
    path = tmp_path / "r.txt"
    path.write_text("earlier")
    AppendOnlyFile(path).close()
    assert path.read_bytes() == b""
