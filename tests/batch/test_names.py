"""Names, kinds and places of recordings: each file is measured, or named as a failure; none ends the others."""

import contextlib
import errno
import functools
import http.server
import io
import json
import os
import shutil
import socket
import subprocess
import sys
import tarfile
import threading
import time
import zipfile

import fsspec
import numpy as np
import pytest
from fsspec.implementations.memory import MemoryFileSystem
from lamp_recordings import ROW_TIME, SHORT, close_folder, lamp

from ocisac_fast.batch import Task, measure_recordings, read_failures, read_results, summarize
from ocisac_fast.batch.recordings import find_recordings
from ocisac_fast.files import FileError, atomic_path, open_recording, read_frames, remote, write_frames
from ocisac_fast.files.pictures import ORIENTATION
from ocisac_fast.files.remote import state_of

GAIN = Task("gain", {"frequency": "500Hz", "row_time": ROW_TIME})
WORDS = ("gain", "--frequency", "500Hz", "--row-time", "22.2us")


def save(path, seed=0):
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "wb") as file:
        np.save(file, lamp(SHORT, seed, (96, 8)))
    return path


def measured(*paths, **options):
    return set(measure_recordings([str(path) for path in paths], GAIN, **options).table["path"].to_pylist())


def test_a_path_that_exists_is_no_pattern(tmp_path):
    wanted, other = save(tmp_path / "a[1].npy"), save(tmp_path / "a1.npy")
    assert measured(wanted) == {str(wanted)}
    assert measured(tmp_path / "a[[]1].npy") == {str(wanted)}
    assert measured(tmp_path / "a[12].npy") == {str(other)}
    in_folder = save(tmp_path / "cam[1]" / "wanted.npy")
    save(tmp_path / "cam1" / "other.npy")
    assert measured(tmp_path / "cam[1]") == {str(in_folder)}
    assert measured(tmp_path / "cam[1]" / "*.npy") == {str(in_folder)}  # nor is a folder of a pattern
    assert measured(tmp_path / "**" / "w*.npy") == {str(in_folder)}
    wild = save(tmp_path / "*?.npy")
    assert measured(wild) == {str(wild)}


def test_absolute_paths_need_no_working_folder(tmp_path, monkeypatch, batch):
    path, gone = save(tmp_path / "r" / "a.npy"), tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert batch(path, tmp_path / "r" / "**", "-o", tmp_path / "o", *WORDS)[0] == 0


def test_links_to_folders_are_not_followed_but_where_they_are_named(tmp_path):
    wanted, other = save(tmp_path / "r" / "a.npy"), save(tmp_path / "elsewhere" / "b.npy")
    os.symlink(tmp_path / "elsewhere", tmp_path / "r" / "link")
    os.symlink(tmp_path / "r", tmp_path / "r" / "loop")
    linked = tmp_path / "r" / "link" / other.name
    assert {one.path for one in find_recordings(tmp_path / "r")} == {str(wanted)}
    for pattern in ("**", "**/*.npy", "*.npy"):
        assert {one.path for one in find_recordings(tmp_path / "r" / pattern)} == {str(wanted)}
    for named in ("link", "link/*.npy", "l?nk/*.npy", "link/b.npy"):
        assert {one.path for one in find_recordings(tmp_path / "r" / named)} == {str(linked)}


@pytest.mark.parametrize("protocol", ["", "memory://", "own://"])
def test_what_this_program_writes_is_no_recording_but_where_it_is_named(protocol, tmp_path, monkeypatch):
    """A film of a killed process, and cleaned recordings of another campaign, were measured as recordings."""
    for name, empty in (("store", {}), ("pseudo_dirs", [""])):
        monkeypatch.setattr(MemoryFileSystem, name, empty)
    fsspec.register_implementation("own", _Found, clobber=True)
    wanted, lamps = save(tmp_path / "r" / "a.npy"), lamp(SHORT, 0, (96, 8))
    save(tmp_path / "r" / "project" / "cleaned" / "b.npy")
    (tmp_path / "r" / "project" / "manifest.json").write_text('{"task": "of another program"}')
    measure_recordings(wanted, Task("clean", {"row_time": ROW_TIME}), output=tmp_path / "r" / "night")
    assert summarize(tmp_path / "r" / "night").recordings
    (tmp_path / "r" / "night" / "summary.png").write_bytes(b"drawn")
    (cleaned,) = (tmp_path / "r" / "night" / "cleaned").iterdir()
    with atomic_path(tmp_path / "r" / "out.npy") as temporary, open(temporary, "wb") as file:
        np.save(file, lamps)
        file.flush()
        root = str(tmp_path / "r")
        if protocol:
            root = f"{protocol}/r"
            fsspec.filesystem(protocol[:-3]).put(str(tmp_path / "r"), "/r", recursive=True)
        everything = {"a.npy", "project/cleaned/b.npy", "project/manifest.json"}
        of_campaign = f"night/cleaned/{cleaned.name}"
        for pattern, names in {
            "": everything,
            "/**": everything,
            "/**/*.npy": {"a.npy", "project/cleaned/b.npy"},
            "/*/cleaned/*.npy": {of_campaign, "project/cleaned/b.npy"},
            "/night/cleaned": {of_campaign},
            f"/{of_campaign}": {of_campaign},
        }.items():
            assert {one.path for one in find_recordings(root + pattern)} == {f"{root}/{name}" for name in names}
        assert "night/task.json" in {one.path.removeprefix(f"{root}/") for one in find_recordings(root + "/night")}


class _Found(MemoryFileSystem):
    """A bucket: it finds files without listing folders."""

    protocol = "own"

    @classmethod
    def _strip_protocol(cls, path):
        return super()._strip_protocol(path.replace("own://", "memory://"))

    def find(self, *arguments, **options):
        return super().find(*arguments, **options)


@pytest.mark.parametrize("pattern", ["", "*/*.npy", "**/*.npy", "c*/*.npy"])
def test_a_folder_that_cannot_be_read_is_a_failure(tmp_path, monkeypatch, pattern):
    wanted, closed = save(tmp_path / "r" / "campaign" / "a.npy"), tmp_path / "r" / "closed"
    save(closed / "b.npy")
    close_folder(closed, monkeypatch)
    done = measure_recordings(tmp_path / "r" / pattern, GAIN)
    assert set(done.table["path"].to_pylist()) == {str(wanted)}
    assert done.failures.to_pylist() == [{"path": str(closed), "message": "Permission denied"}]


@pytest.mark.parametrize("pattern", ["", "/*/*.npy", "/**/*.npy"])
def test_a_remote_folder_that_cannot_be_read_is_a_failure(monkeypatch, pattern):
    system = fsspec.filesystem("memory")
    system.store.clear()
    for name in ("open/a.npy", "shut/b.npy"):
        with fsspec.open(f"memory://r/{name}", "wb") as file:
            np.save(file, lamp(SHORT, 0, (96, 8)))
    listed = type(system).ls

    def ls(self, path, detail=True, **options):
        if path.endswith("/shut"):
            raise RuntimeError("530 not for you")  # that of FTP is no OSError either
        return listed(self, path, detail, **options)

    monkeypatch.setattr(type(system), "ls", ls)
    monkeypatch.setattr(type(system), "find", fsspec.AbstractFileSystem.find)
    done = measure_recordings(f"memory://r{pattern}", GAIN)
    assert done.table["path"].unique().to_pylist() == ["memory://r/open/a.npy"]
    assert done.failures.to_pylist() == [{"path": "memory://r/shut", "message": "530 not for you"}]


def test_folders_in_folders_of_any_depth(tmp_path):
    """More than Python recurses; a path that is longer than the system takes is a failure."""
    wanted, at = save(tmp_path / "x.npy"), os.open(tmp_path, os.O_RDONLY)
    for name in [*["a"] * 1000, *["b" * 250] * 9]:
        os.mkdir(name, dir_fd=at)
        above, at = at, os.open(name, os.O_RDONLY, dir_fd=at)
        os.close(above)
    os.close(at)
    try:
        for pattern in ("", "**/*.npy"):
            failures = {entry.path: entry.failure for entry in find_recordings(tmp_path / pattern)}
            assert failures.pop(str(wanted)) == ""
            assert set(failures.values()) == {"File name too long"}
    finally:
        subprocess.run(["rm", "-rf", str(tmp_path / "a")], check=True)


@pytest.mark.parametrize("pattern", ["x/*.npy", "**/*.npy", "*/*.npy", "x/d/*/*.npy"])
def test_a_folder_that_may_be_listed_but_not_entered_ends_no_pattern(tmp_path, monkeypatch, pattern):
    save(tmp_path / "x" / "a.npy")
    save(tmp_path / "x" / "d" / "e" / "b.npy")
    stat = os.stat

    def refused(path, *rest, **options):
        if not isinstance(path, int) and os.fspath(path).startswith(str(tmp_path / "x" / "")):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), path)
        return stat(path, *rest, **options)

    monkeypatch.setattr(os, "stat", refused)
    with contextlib.suppress(ValueError):  # none there, which is said
        assert {one.path for one in find_recordings(tmp_path / pattern)} >= {str(tmp_path / "x" / "a.npy")}


def test_a_recording_may_have_the_name_of_a_command(tmp_path, monkeypatch, run, batch):
    monkeypatch.chdir(tmp_path)
    save(tmp_path / "clean" / "a.npy")
    assert batch("clean", "-o", "r", *WORDS)[0] == 0
    assert [one.path for one in summarize("r").recordings] == [str(tmp_path / "clean" / "a.npy")]
    assert batch("clean", "-o", "c", "clean", "--row-time", ROW_TIME)[0] == 0
    assert run("batch", "clean/*.npy", "-o", "d", "clean", "--row-time", ROW_TIME)[0] == 0


def test_names_of_any_bytes(tmp_path, batch):
    """A name that is not UTF-8 is measured or listed as a failure like any other, in a first run and in a second."""
    names = [b"caf\xe9.npy", b"caf\xea.npy"]  # two recordings of the table too
    names += [b"a\nb.npy", b"\x1b]0;x\x07.npy", b"~root.npy", b" .npy", "汉".encode() * 80 + b".npy"]
    sources = [save(tmp_path / "r" / os.fsdecode(name)) for name in names]
    (tmp_path / "r" / os.fsdecode(b"bad\xff.npy")).write_bytes(b"")
    results = tmp_path / "results"
    for skipped in (0, len(names)):
        done = measure_recordings(tmp_path / "r", GAIN, output=results).progress
        assert (done.finished, done.skipped, done.failed) == (len(names), skipped, 1)
    assert read_results(results).num_rows == SHORT * len(names)
    assert [one.path for one in summarize(results).recordings] == sorted(map(str, sources))
    assert read_failures(results)["path"].to_pylist() == [str(tmp_path / "r" / "bad\\xff.npy")]
    assert batch("--summary", results, "--json")[0] == 0
    code, shown, _ = batch("--summary", results)
    assert code == 0
    assert any("\\x1b]0;x\\x07.npy" in line for line in shown)
    assert all(line.isprintable() for line in shown)
    cleaning = Task("clean", {"row_time": ROW_TIME})
    done = measure_recordings(tmp_path / "r", cleaning, output=tmp_path / "cleaned").progress
    assert (done.finished, done.failed) == (len(names), 1)


def test_above_a_link_is_the_folder_above_that_which_it_leads_to(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for seed, folder in enumerate((tmp_path, tmp_path / "real")):
        save(folder / "x.npy", seed)
    (tmp_path / "real" / "sub").mkdir()
    (tmp_path / "link").symlink_to("real/sub")
    measure_recordings(["link/../x.npy"], GAIN, output="link/../res")
    assert set(read_results("real/res")["path"].to_pylist()) == {str(tmp_path / "real" / "x.npy")}
    assert not (tmp_path / "res").exists()


def test_pipes_sockets_and_lost_links_are_failures(tmp_path, monkeypatch):
    """None is waited for."""
    source = save(tmp_path / "r" / "a.npy")
    os.mkfifo(tmp_path / "r" / "pipe.npy")
    (tmp_path / "r" / "lost.npy").symlink_to(tmp_path / "nothing")
    (tmp_path / "r" / "device.npy").symlink_to("/dev/zero")
    (tmp_path / "r" / "link.npy").symlink_to(source)
    (tmp_path / "r" / "folder").symlink_to(tmp_path)
    with socket.socket(socket.AF_UNIX) as server:
        monkeypatch.chdir(tmp_path / "r")  # names of sockets are short
        server.bind("socket.npy")
        done = measure_recordings([tmp_path / "r", tmp_path / "r" / "pipe.npy"], GAIN)
    assert done.table["path"].unique().to_pylist() == [str(source), str(tmp_path / "r" / "link.npy")]
    failed = {os.path.basename(row["path"]): row["message"] for row in done.failures.to_pylist()}
    kind = "a pipe, device or folder, allowed: a file"
    lost = "No such file or directory"
    assert failed == {"pipe.npy": kind, "device.npy": kind, "socket.npy": kind, "lost.npy": lost}


def test_a_local_name_that_looks_like_a_url(tmp_path, monkeypatch, run):
    monkeypatch.chdir(tmp_path)
    names = [save(tmp_path / name) for name in ("a::b.npy", "memory::c.npy")]
    assert measured(*(name.name for name in names)) == set(map(str, names))
    assert measured(tmp_path) == set(map(str, names))
    assert run("gain", "a::b.npy", *WORDS[1:])[0] == 0


@pytest.mark.parametrize("url", ["s3://bucket/a.npy", "nothing://a.npy"])
def test_a_file_system_that_is_not_installed_is_one_line(url, tmp_path, run, batch, monkeypatch):
    monkeypatch.setitem(sys.modules, "s3fs", None)
    made = save(tmp_path / "a.npy")
    done = [batch(url, "-o", tmp_path / "o", *WORDS), batch(made, "-o", url, *WORDS), run("gain", url, *WORDS[1:])]
    for code, _, (line,) in done:
        assert code == 2
        assert line.startswith(f"ocisac: {url}: ")


@pytest.mark.parametrize("kind", ["zip", "tar"])
def test_recordings_in_archives(kind, tmp_path, monkeypatch):
    monkeypatch.setattr("ocisac_fast.files.remote._WHOLE", 1000)
    save(tmp_path / "in" / "a.npy")
    archive = shutil.make_archive(str(tmp_path / "all"), kind, tmp_path, "in")
    for name in ("a.npy", "*.npy"):
        assert measured(f"{kind}://in/{name}::{archive}") == {f"{kind}://in/a.npy::{archive}"}
    (before,) = find_recordings(f"{kind}://in/a.npy::{archive}")
    for seed in (1, 1):  # another array of the same size, then another archive of it
        os.utime(save(tmp_path / "in" / "a.npy", seed), (1e9, 1e9))
        shutil.make_archive(str(tmp_path / "all"), kind, tmp_path, "in")
        (after,) = find_recordings(f"{kind}://in/a.npy::{archive}")
        assert (after.path, after.size, after.state == before.state) == (*before[:2], False)
        assert np.array_equal(read_frames(after.path).frames, np.load(tmp_path / "in" / "a.npy"))
        before = after


@pytest.mark.parametrize("name", ["file:///x", "zip://z::{}", "ftp://127.0.0.1:1/q.zip"])
def test_a_name_in_an_archive_is_no_address(name, tmp_path, monkeypatch, batch):
    """Its author does not choose what is opened: neither another archive nor a file nor a server."""
    data = save(tmp_path / "a.npy").read_bytes()
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as other:
        other.writestr("z", data)
    names = [f"b.npy::{name.format(tmp_path / 'other.zip')}", "zip://a.npy", "/a.npy"]
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        for each in ("a.npy", *names):
            archive.writestr(each, data)
    url = "zip://{}::" + str(tmp_path / "all.zip")
    code, out, _ = batch(url.format("**"), tmp_path / "a.npy", "-o", tmp_path / "o", "--json", *WORDS)
    assert (code, json.loads(*out)["finished"]) == (3, 2)
    message = "a name that would be read as another path, allowed: a copy of it outside"
    assert read_failures(tmp_path / "o").to_pylist() == [
        {"path": url.format(each), "message": message} for each in sorted(names)
    ]


def test_a_name_in_an_archive_like_an_address_needs_no_library(tmp_path, run, monkeypatch):
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    remote._bounded.cache_clear()
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("http://h/a.npy", save(tmp_path / "a.npy").read_bytes())
    assert run("gain", f"zip://http://h/a.npy::{tmp_path / 'a.zip'}", *WORDS[1:])[0] == 0


@pytest.mark.filterwarnings("ignore:Duplicate name")
@pytest.mark.parametrize("kind", ["zip", "tar"])
def test_members_of_one_name_are_a_failure(kind, tmp_path, run, batch):
    """The last one was measured as if there were no other."""
    url = f"{kind}://{{}}::{tmp_path / 'a'}"
    with zipfile.ZipFile(tmp_path / "a", "w") if kind == "zip" else tarfile.open(tmp_path / "a", "w") as archive:
        add = archive.write if kind == "zip" else archive.add
        for name, seed in (("a.npy", 0), ("b.npy", 1), ("a.npy", 2)):
            add(save(tmp_path / "one", seed), name)
    code, out, err = batch(url.format("**"), "-o", tmp_path / "o", "--json", *WORDS)
    message = "2 members of its archive have this name, allowed: one"
    assert (code, json.loads(*out)["finished"], err) == (3, 1, [f"ocisac: failed: {url.format('a.npy')}: {message}"])
    assert run("gain", url.format("a.npy"), *WORDS[1:]) == (2, [], [f"ocisac: {url.format('a.npy')}: {message}"])


def test_members_that_are_no_files_are_failures(tmp_path):
    kinds = {"device": b"3", "pipe": b"6", "loop": b"2", "itself": b"1", "lost": b"2", "file": b"0"}
    links = {"loop": "loop", "itself": "itself", "lost": "none"}
    data = save(tmp_path / "a.npy").read_bytes()
    with tarfile.open(tmp_path / "a.tar", "w") as archive:
        for name, kind in kinds.items():
            member = tarfile.TarInfo(name)
            member.type, member.linkname, member.size = kind, links.get(name, ""), len(data) * (name == "file")
            archive.addfile(member, io.BytesIO(data))
    done = measure_recordings(f"tar://*::{tmp_path / 'a.tar'}", GAIN)
    assert done.progress.finished == 1
    assert done.failures["message"].to_pylist() == ["no file, nor a link to one"] * 5


@pytest.mark.parametrize("kind", ["zip", "tar"])
def test_an_archive_that_changes_while_it_is_read_is_refused(kind, tmp_path):
    save(tmp_path / "in" / "a.npy")
    archive = shutil.make_archive(str(tmp_path / "all"), kind, tmp_path, "in")
    with open_recording(f"{kind}://in/a.npy::{archive}") as stream:
        next(iter(stream))
        os.utime(archive, (1e9, 1e9))
        with pytest.raises(FileError, match="changed while it was read"):
            list(stream)


@pytest.mark.parametrize("name", ["Last-Modified", "modificationTime", "LastModified", "ETag", "etag", "content_md5"])
def test_a_mark_of_change_has_a_name_of_its_file_system(name):
    """HTTP, WebHDFS and buckets state marks of change; the number of changes of a file's metadata is none."""
    entry = {"size": 3, "metageneration": 1, name: "now", "created": "then"}
    assert state_of(entry) != state_of({**entry, name: "later"})
    assert state_of({"size": 3, "metageneration": 1, name: None}) is None


class Server(http.server.BaseHTTPRequestHandler):
    """Answers as the name says: a file, an error, a body that is cut or no gzip, a redirect to itself, 300 MB."""

    body = b""
    asked: list[tuple[str, str]] = []  # noqa: RUF012
    sent = 0  # MiB of answers without an end
    protocol_version = "HTTP/1.1"

    def log_message(self, *_):
        pass

    def do_HEAD(self):
        self.do_GET()

    def do_GET(self):
        self.asked.append((self.command, self.path))
        is_chunked = "pieces" in self.path or (self.command == "GET" and "endless" in self.path)
        length = {"big": 300 << 20, "cut": len(self.body) + 10}.get(self.path[1:4], len(self.body))
        self.send_response({"bad": 500, "rou": 302, "ran": 206}.get(self.path[1:4], 200))
        for name, value in {
            "Location": self.path if "round" in self.path else None,
            "Content-Encoding": "gzip" if "zip" in self.path else None,
            "Content-Length": None if is_chunked else 200 << 20 if "range" in self.path else length,
            "Accept-Ranges": "bytes",
            "Transfer-Encoding": "chunked" if is_chunked else None,
        }.items():
            if value is not None:
                self.send_header(name, str(value))
        self.end_headers()
        self.close_connection = True
        if self.command == "GET" and "endless" in self.path:
            with contextlib.suppress(OSError):
                for _ in range(1 << 12):  # 4 GiB
                    self.wfile.write(b"100000\r\n" + bytes(1 << 20) + b"\r\n")
                    Server.sent += 1
        elif self.command == "GET" and is_chunked:
            for k in range(0, len(self.body), 4096):
                piece = self.body[k : k + 4096]
                self.wfile.write(b"%x\r\n%b\r\n" % (len(piece), piece))
                time.sleep(0.01)
            self.wfile.write(b"0\r\n\r\n")
        elif self.command == "GET":
            with contextlib.suppress(OSError):
                self.wfile.write(self.body)


@pytest.fixture
def server(tmp_path):
    pytest.importorskip("aiohttp")
    Server.body = save(tmp_path / "served.npy").read_bytes()
    Server.asked.clear()
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Server) as started:
        threading.Thread(target=started.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{started.server_port}"
        started.shutdown()


def test_a_server_that_says_nothing_is_not_waited_for(monkeypatch):
    pytest.importorskip("aiohttp")
    monkeypatch.setattr(remote, "_SILENCE", 0.5)
    remote._bounded.cache_clear()
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"http://127.0.0.1:{silent.getsockname()[1]}/a.npy"
        with pytest.raises(OSError, match=r"Timeout|no answer"):
            read_frames(url)
    remote._bounded.cache_clear()


def test_what_a_server_answers_is_the_failure_of_one_recording(server, tmp_path, run, batch):
    """None is fetched to be listed."""
    bad = ["bad.npy", "cut.npy", "round.npy", "zip.npy"]
    urls = [f"{server}/{name}" for name in ("a.npy", *bad, "c[1].npy", "d.npy?x=1*")]
    code, out, _ = batch(*urls, "-o", tmp_path / "o", "--json", *WORDS)
    done = json.loads(*out)
    assert (code, done["finished"], done["failed"]) == (3, 3, 4)
    messages = {row["path"]: row["message"] for row in read_failures(tmp_path / "o").to_pylist()}
    assert set(messages) == {f"{server}/{name}" for name in bad}
    assert "500" in messages[f"{server}/bad.npy"]
    for name in bad:
        code, _, err = run("gain", f"{server}/{name}", *WORDS[1:])
        assert (code, len(err)) == (2, 1)


@pytest.mark.parametrize("name", ["endless.npy", "range-endless.npy"])
def test_an_answer_without_an_end_is_a_failure(server, name, run):
    """Of a small file, and of a range of a large one: no more than 64 MiB are held."""
    Server.sent = 0
    code, _, err = run("gain", f"{server}/{name}", *WORDS[1:])
    assert code == 2
    assert "an answer of more than 64 MiB" in err[-1]
    assert 64 <= Server.sent < 256


@pytest.mark.parametrize("suffix", ["npy", "mkv"])
def test_a_large_file_of_a_server_without_ranges_is_one_line(server, suffix, run, tmp_path, monkeypatch):
    write_frames(tmp_path / f"a.{suffix}", lamp(9, 1))
    Server.body = (tmp_path / f"a.{suffix}").read_bytes()
    monkeypatch.setattr("ocisac_fast.files.remote._WHOLE", 1000)
    code, _, (line,) = run("gain", f"{server}/a.{suffix}", *WORDS[1:])
    assert (code, line.partition(", ")[2]) == (2, "and its server gives no parts, allowed: a copy of it")


def test_an_answer_in_pieces_of_no_stated_size_is_read_to_its_end(server, tmp_path, run):
    code, out, _ = run("gain", f"{server}/pieces.npy", "--json", *WORDS[1:])
    _, local, _ = run("gain", tmp_path / "served.npy", "--json", *WORDS[1:])
    assert code == 0
    remote, local = ({**json.loads(line), "path": ""} for line in (out[0], local[0]))
    assert remote == local


class Folder(http.server.SimpleHTTPRequestHandler):
    """The files of a folder, with their times unless they are hidden; ``asked`` is called before a file is sent."""

    is_timed = True
    asked = staticmethod(lambda: None)

    def log_message(self, *_):
        pass

    def send_header(self, keyword, value):
        if self.is_timed or keyword != "Last-Modified":
            super().send_header(keyword, value)

    def do_GET(self):
        self.asked()
        super().do_GET()


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder and its address on a server."""
    pytest.importorskip("aiohttp")
    place = tmp_path / "served"
    os.utime(save(place / "d" / "a.npy"), (1e9, 1e9))
    save(place / "d" / "below" / "b.npy")
    monkeypatch.setattr(Folder, "is_timed", True)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Folder, directory=place)) as started:
        threading.Thread(target=started.serve_forever, daemon=True).start()
        yield place, f"http://127.0.0.1:{started.server_port}"
        started.shutdown()


@pytest.mark.parametrize("name", ["d/a.npy", "d/*.npy", "d/"])
def test_a_recording_on_a_server_that_changed_is_measured_again(folder, tmp_path, monkeypatch, name):
    """Raw frames and arrays of a camera have one size; where no time is stated, each is measured in each run."""
    place, url = folder
    count = 2 if name == "d/" else 1

    def skipped():
        done = measure_recordings(f"{url}/{name}", GAIN, output=tmp_path / "o").progress
        assert (done.recordings, done.finished) == (count, count)
        return done.skipped

    assert (skipped(), skipped()) == (0, count)
    before = read_results(tmp_path / "o")
    save(place / "d" / "a.npy", 1)
    assert skipped() == count - 1
    after = read_results(tmp_path / "o")
    assert after["path"][0].as_py() == f"{url}/d/a.npy"
    assert after["gain"][0] != before["gain"][0]
    monkeypatch.setattr(Folder, "is_timed", False)
    assert (skipped(), skipped()) == (0, 0)


def test_a_recording_on_a_server_that_changes_while_it_is_read_is_refused(folder, run, tmp_path, monkeypatch):
    place, url = folder
    monkeypatch.setattr(Folder, "asked", staticmethod(lambda: save(place / "d" / "a.npy", 1)))
    code, _, err = run("gain", f"{url}/d/a.npy", *WORDS[1:])
    assert (code, len(err)) == (2, 1)
    assert "changed while it was read" in err[0]
    os.utime(place / "d" / "a.npy", (1.1e9, 1.1e9))
    done = measure_recordings(f"{url}/d/a.npy", GAIN, output=tmp_path / "o")
    assert "changed while it was" in done.failures.to_pylist()[0]["message"]


def test_folders_of_a_server_without_an_end_are_one_line(folder, tmp_path, monkeypatch, batch):
    """Two links to one folder were 2^40 listings."""
    place, url = folder
    monkeypatch.setattr("ocisac_fast.batch.recordings._MOST_FOLDERS", 100)
    for link in ("one", "two"):
        (place / "d" / link).symlink_to(place / "d", target_is_directory=True)
    code, _, err = batch(f"{url}/d/", "-o", tmp_path / "o", *WORDS)
    assert (code, err) == (
        2,
        [f"ocisac: recordings: got {url}/d/, allowed: at most 100 folders below one of a web server"],
    )


def test_a_broken_configuration_of_file_systems_is_named(tmp_path, program):
    (tmp_path / "a.json").write_text("{")
    save(tmp_path / "a.npy")
    configured = {**os.environ, "FSSPEC_CONFIG_DIR": str(tmp_path)}
    done = program("batch", "a.npy", "-o", "o", "--workers", 0, *WORDS, cwd=tmp_path, env=configured)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert done.stderr.startswith(f"ocisac: {tmp_path}: fsspec's configuration cannot be read: ")


@pytest.fixture
def pictures(tmp_path):
    """Folder of a turned photograph, one with opacity, and frames of floats; a picture of Pillow."""
    image = pytest.importorskip("PIL.Image")
    place = tmp_path / "r"
    place.mkdir()
    frames = lamp(2, 1)
    exif = image.Exif()
    exif[ORIENTATION] = 6
    grey = image.fromarray(frames[0])
    grey.save(place / "photo.jpg", exif=exif)
    grey.convert("RGBA").save(place / "opaque.png", exif=exif)
    np.save(place / "float.npy", frames / np.float32(255))
    return place, grey


def cleaned(tmp_path, path, **options):
    """Clean the recordings of a path; return the place of each cleaned file by the name of its recording."""
    task = Task("clean", {"row_time": ROW_TIME, **options})
    assert not measure_recordings(str(path), task, output=tmp_path / "o").failures.num_rows
    rows = read_results(tmp_path / "o").to_pylist()
    return {os.path.basename(row["path"].partition("::")[0]): row["cleaned"] for row in rows}


def test_members_of_an_archive_are_cleaned_to_pictures_and_arrays_as_files_are(tmp_path, pictures):
    """The suffix of the path is the archive's: pictures became films without turn and opacity, floats failed."""
    place, _ = pictures
    shutil.make_archive(str(tmp_path / "all"), "zip", place)
    found = cleaned(tmp_path, f"zip://*::{tmp_path / 'all.zip'}")
    names = {name: os.path.basename(path).partition("-")[2] for name, path in found.items()}
    assert names == {"photo.jpg": "photo.png", "opaque.png": "opaque.png", "float.npy": "float.npy"}
    image = pytest.importorskip("PIL.Image")
    for name, mode in (("photo.jpg", "L"), ("opaque.png", "RGBA")):
        with image.open(found[name]) as picture:
            assert (picture.getexif()[ORIENTATION], picture.mode) == (6, mode)
    assert np.load(found["float.npy"]).dtype == np.float32


def test_the_kind_of_what_is_cleaned_is_that_of_the_recording_whatever_its_name(tmp_path, pictures):
    place, grey = pictures
    kinds = tmp_path / "kinds"
    kinds.mkdir()
    shutil.copy(place / "photo.jpg", kinds / "a.jpe")
    shutil.copy(place / "opaque.png", kinds / "IMG_0001")
    shutil.copy(place / "photo.jpg", kinds / "photo.tif")
    shutil.copy(place / "float.npy", kinds / "array.png")
    grey.convert("RGBA").save(kinds / "c.webp", lossless=True)
    grey.save(kinds / "d.bmp")
    grey.save(kinds / "e", "TIFF")
    grey.save(kinds / "animated.png", save_all=True, append_images=[grey.rotate(180)])
    write_frames(kinds / "film.mkv", lamp(2, 1))
    (kinds / "film.mkv").rename(kinds / "film.png")
    found = {name: os.path.splitext(path)[1] for name, path in cleaned(tmp_path, kinds).items()}
    single = dict.fromkeys(("a.jpe", "IMG_0001", "photo.tif", "c.webp", "d.bmp"), ".png")
    assert found == {**single, "e": ".tif", "array.png": ".npy", "film.png": ".mkv", "animated.png": ".mkv"}


def test_a_picture_of_a_server_with_a_query_is_cleaned_to_a_picture(server, tmp_path, pictures):
    place, _ = pictures
    Server.body = (place / "photo.jpg").read_bytes()
    (path,) = cleaned(tmp_path, f"{server}/photo.jpg?signature=a/b").values()
    assert os.path.basename(path).partition("-")[2] == "photo.png"


def test_raw_frames_are_cleaned_to_a_film_whatever_their_name(tmp_path):
    (tmp_path / "a.png").write_bytes(lamp(2, 1).tobytes())
    (path,) = cleaned(tmp_path, tmp_path / "a.png", raw="48x240").values()
    assert path.endswith("-a.mkv")


def test_listing_fetches_nothing(server):
    assert [entry.size for entry in find_recordings(f"{server}/big.npy")] == [300 << 20]
    assert {method for method, _ in Server.asked} == {"HEAD"}
