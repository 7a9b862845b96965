"""Files that a task reads beside each recording, as ``sense --unlit`` does, and outputs beside the results."""

import hashlib

import pytest

from ocisac_fast.batch import recordings as found


@pytest.mark.parametrize("place", ["file", "memory"])
def test_the_hash_of_a_long_file_is_of_its_ends(place, tmp_path, monkeypatch):
    """A hole of terabytes, which costs its maker nothing, was read to its end."""
    system = pytest.importorskip("fsspec").filesystem(place)
    path = str(tmp_path / "a") if place == "file" else "memory://a"
    sparse = tmp_path / "sparse"
    with sparse.open("wb") as file:
        file.truncate(1 << 40)
    end = bytes(64 << 20)
    assert found.content_hash(str(sparse)) == {"sha256_of_ends": hashlib.sha256(end + end).hexdigest()}
    monkeypatch.setattr(found, "_LONG", 100)
    monkeypatch.setattr(found, "_END", 30)
    for length, key, hashed in ((100, "sha256", range(100)), (120, "sha256_of_ends", [*range(30), *range(90, 120)])):
        system.pipe_file(path, bytes(range(length)))
        assert found.content_hash(path) == {key: hashlib.sha256(bytes(hashed)).hexdigest()}
