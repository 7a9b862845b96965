"""Tables of commands as CSV files."""

import csv
import json
import re
import sys

import click
import numpy as np
import pytest

import ocisac_fast
from ocisac_fast.cli.application import ocisac
from ocisac_fast.cli.csv_files import write_csv
from ocisac_fast.cli.output import Table

TESTBED = ("--row-time", "22.2us", "--exposure", "622us")
DARK = ("--dark-level", "16")  # so that noise is not clipped at 0


def rows_of(path):
    return list(csv.DictReader(path.read_text().splitlines()))


def test_csv_has_a_row_for_each_object_of_a_list(tmp_path):
    records = [
        {"frame": 0, "bits": "01", "flags": ["weak", "aliased"], "lights": [{"x": 1, "frame": 5}, {"x": 2, "y": None}]},
        {"frame": 1, "flags": [], "versions": {"numpy": "2"}, "places": [[1, 2], [3]], "holds": True},
    ]
    write_csv(tmp_path / "objects.csv", records)
    assert (tmp_path / "objects.csv").read_text().splitlines() == [
        "frame,bits,flags,x,lights.frame,y,versions.numpy,places,holds",
        "0,01,weak aliased,1,5,,,,",
        "0,01,weak aliased,2,,,,,",
        '1,,,,,,2,"[[1, 2], [3]]",true',
    ]


def test_every_command_writes_csv():
    context = click.Context(ocisac)
    for name in ocisac.list_commands(context):
        command = ocisac.get_command(context, name)
        options = {word for param in command.params for word in param.opts}
        assert {"--json", "--csv", "--table", "--force"} <= options, name


def test_csv_holds_what_json_prints(run, facts, square, tmp_path):
    command = ("gain", square("s.mkv", "--frames", 2), *TESTBED, *DARK, "--frequency", "500", "--waveform", "square")
    (want,) = facts(*command)
    code, out, err = run(*command, "--csv", tmp_path / "gain.csv")
    assert (code, out, err) == (0, [], [])
    (row,) = rows_of(tmp_path / "gain.csv")
    assert float(row["gain"]) == want["gain"]
    assert (row["flags"], row["frequency_std_hz"], row["frames"]) == ("", "", "2")
    assert run(*command, "--csv", tmp_path / "gain.csv")[0] == 2  # it exists
    code, out, _ = run(*command, "--csv", "-", "--json")
    assert (code, json.loads(out[0]), out[2].split(",")[2]) == (0, want, row["gain"])


def test_gain_writes_a_value_for_each_column_and_frame(run, square, tmp_path):
    path = square("s.npy", "--frames", 3)
    command = ("gain", path, *TESTBED, *DARK, "--frequency", "500", "--region", "5,0,7,720")
    assert run(*command, "--per-column", tmp_path / "columns.csv")[0] == 0
    rows = rows_of(tmp_path / "columns.csv")
    places = [(str(frame), str(column)) for frame in range(3) for column in range(5, 12)]
    assert [(row["frame"], row["column"]) for row in rows] == places
    camera = ocisac_fast.Camera(22.2e-6, 622e-6, dark_level=16)
    want = ocisac_fast.tone_gain(np.load(path)[..., 5:12], camera, 500.0)
    assert np.array([float(row["gain"]) for row in rows]) == pytest.approx(want.gain.ravel(), rel=1e-12)
    assert {row["used"] for row in rows} == {"true"}


def test_an_error_after_some_results_leaves_their_csv(run, square, tmp_path):
    missing = tmp_path / "missing.png"
    assert run("receive", square("s.png"), missing, *TESTBED, "--csv", tmp_path / "bits.csv")[0] == 3
    assert len((tmp_path / "bits.csv").read_text().splitlines()) >= 2
    assert run("receive", missing, *TESTBED, "--csv", tmp_path / "none.csv")[0] == 2
    assert not (tmp_path / "none.csv").exists()


def test_tables_are_written_by_suffix(run, facts, square, tmp_path):
    parquet, scipy_io = pytest.importorskip("pyarrow.parquet"), pytest.importorskip("scipy.io")
    command = ("detect", square("s.npy", "--frames", 2), *TESTBED, *DARK)
    want = [source for frame in facts(*command) for source in frame["sources"]]
    assert len(want) == 2
    for suffix in ("csv", "parquet", "mat"):
        assert run(*command, "--table", tmp_path / f"t.{suffix}") == (0, [], [])
    table = parquet.read_table(tmp_path / "t.parquet").to_pylist()
    matlab = scipy_io.loadmat(tmp_path / "t.mat", simplify_cells=True)["results"]
    for k, source in enumerate(want):
        assert table[k]["frequency_hz"] == matlab["frequency_hz"][k] == source["frequency_hz"]
        assert table[k]["flags"] == source["flags"]
        assert float(rows_of(tmp_path / "t.csv")[k]["gain"]) == table[k]["gain"] == matlab["gain"][k]
        assert np.isnan(matlab["reflection_of"][k])
    assert run(*command, "--table", "-")[1][0].startswith("frame,")


@pytest.mark.parametrize(
    ("option", "name", "allowed"),
    [
        ("--csv", "g.parquet", r".csv (--table writes .parquet and .mat)"),
        ("--table", "g.txt", ".csv, .parquet or .mat"),
    ],
)
def test_tables_of_other_kinds_are_refused(run, option, name, allowed, tmp_path):
    code, out, (line,) = run("info", option, tmp_path / name)
    assert (code, out) == (2, [])
    assert line.startswith(f"ocisac: {option}: got ")
    assert line.endswith(f"allowed: a name that ends with {allowed}")
    assert not (tmp_path / name).exists()


def test_the_library_of_a_table_is_missed_before_the_work(run, square, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "scipy.io", None)
    made = ("--plot", tmp_path / "p.png", "--table", tmp_path / "t.mat")
    code, out, (line,) = run("flicker", "--lights", "mains", "--exposures", "1ms,2ms", *made)
    assert (code, out, "scipy" in line) == (2, [], True)
    assert list(tmp_path.glob("[pt].*")) == []


def test_tables_fit_into_a_narrow_terminal(run, square, monkeypatch):
    for name, value in {"FORCE_COLOR": "1", "COLUMNS": "80", "TERM": "dumb"}.items():
        monkeypatch.setenv(name, value)
    film = square("s.npy", "--frames", 2)
    for command in (("detect", film), ("receive", film), ("gain", film, "--frequency", 500)):
        code, out, _ = run(*command, *TESTBED, *DARK)
        lines = [line.rstrip() for line in out]
        assert code == 0
        assert max(map(len, lines)) <= 80, command
    header = next(line for line in run("detect", film, *TESTBED, *DARK)[1] if "light" in line)
    assert header.split()[:5] == ["light", "x", "y", "width", "height"]


@pytest.mark.parametrize("name", ["x.npy", "a_rather_long_name_of_a_recording.npy"])
def test_all_rows_are_printed_at_every_width_of_a_terminal(name, monkeypatch, capsys):
    """A row below the first ones failed where the terminal was too narrow for them."""
    names = ("frame", "file", "SNR", "rows per chip", "chip rate", "flags", "bits", "payload")
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    for width in range(5, 121):
        monkeypatch.setenv("COLUMNS", str(width))
        table = Table(names, left=("file", "flags", "bits", "payload"), spare=("rows per chip",))
        for k in range(30):
            table.add([str(k), name, "56.3 dB", "3.003", "15 k", "none", k * "z", k // 9 * "qqqq "], "")
        table.end("")
        out = click.unstyle(capsys.readouterr().out)
        assert [int(number) for number in re.findall(r"(?m)^  (\d+) ", out)] == list(range(30)), width
        assert (out.count("z"), out.count("q")) == (435, 4 * 36), width
        assert all(column in out for column in names)
        assert width < 70 or max(map(len, out.splitlines())) <= width


def test_detect_sums_up_a_film(run, square):
    code, out, _ = run("detect", square("s.npy", "--frames", 3), *TESTBED, *DARK)
    at = next(k for k, line in enumerate(out) if "lights of 3 frames" in line)
    assert code == 0
    assert out[at + 4].split()[:2] == ["0", "3"]
    assert "500" in out[at + 4]
