"""gsvrinfo and gsvrreport: tables, JSON, CSV, verification."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests import making
from tests.cli.tools import ROOT, Runner


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> Runner:
    return Runner(capsys)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return making.gsvr_file(tmp_path / "a.gsvr", size=(160, 120), settings={"seed": 7, "gop": None})


class TestInfo:
    def test_table(self, cli: Runner, path: Path) -> None:
        result = cli("gsvrinfo", path)
        assert (result.code, result.err) == (0, "")
        lines = result.out.splitlines()
        assert all(len(line) <= 80 for line in lines if "file" not in line)
        assert "picture    160x120, 8 bit, untagged limited range" in lines
        assert "frames     12 at 25 a second" in lines
        assert "settings   seed 7" in lines

    def test_gops(self, cli: Runner, path: Path) -> None:
        rows = cli("gsvrinfo", "--gops", path).out.partition("\n\n")[2].splitlines()
        assert [row.split()[:2] for row in rows[1:]] == [["0", "5"], ["5", "3"], ["8", "4"]]
        assert {len(row) for row in rows} == {len(rows[0])}

    def test_predicted_gops(self, cli: Runner, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", predicted=True)
        text, _, table = cli("gsvrinfo", "--gops", "--bits", path).out.partition("\n\n")
        assert "GOPs       3, 1 of them key GOPs" in text.splitlines()
        assert "Gaussians  180, 96 of them carried over" in text.splitlines()
        gops, bits = (part.splitlines() for part in table.split("\n\n"))
        assert max(map(len, gops)) == 80
        assert [row.split()[3:8] for row in gops[1:]] == [
            ["key", "-", "-", "-", "60"],
            ["0", "48", "24", "24", "12"],
            ["5", "48", "24", "24", "12"],
        ]
        names = [row.split()[0] for row in bits]
        assert names.index("quadratic") < names.index("mode") < names.index("position_change")
        assert max(map(len, bits)) <= 80

    def test_bits(self, cli: Runner, path: Path) -> None:
        lines = cli("gsvrinfo", "--bits", path).out.partition("\n\n")[2].splitlines()
        assert max(map(len, lines)) <= 80
        rows = [line.split() for line in lines[1:]]
        sizes = [int(row[1].replace(",", "")) for row in rows]
        assert [rows[0][0], rows[-1][0]] == ["position", "all"]
        assert sum(sizes[:-1]) == sizes[-1] == path.stat().st_size
        spending = json.loads(cli("gsvrinfo", path, "--json").out)["spending"]
        assert [item["bytes"] for item in spending.values()] == sizes[:-1]
        assert float(rows[0][3]) == pytest.approx(
            spending["position"]["bits_per_gaussian"], abs=5e-3
        )

    def test_sums_are_named(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        sums = making.gsvr_file(tmp_path / "sums.gsvr", blending="sum")
        assert "version    1.0, pictures are sums\n" in cli("gsvrinfo", sums).out
        assert "pictures are" not in cli("gsvrinfo", path).out

    def test_control_characters_are_not_printed(self, cli: Runner, tmp_path: Path) -> None:
        hostile = making.gsvr_file(tmp_path / "a.gsvr", settings={"a": "\x1b[2J\u202e"})
        out = cli("gsvrinfo", hostile).out
        assert "\x1b" not in out
        assert "\u202e" not in out

    @pytest.mark.parametrize("args", [["--json"], ["--json", "-"]])
    def test_json(self, cli: Runner, path: Path, args: list[str]) -> None:
        data = json.loads(cli("gsvrinfo", path, *args).out)
        keys = ("frames", "width", "height", "gops", "gaussians")
        assert [data[key] for key in keys] == [12, 160, 120, 3, 180]
        assert data["bytes"] == path.stat().st_size
        assert {"parameters", "bpp", "version"} <= set(data)

    def test_json_file(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        target = tmp_path / "info.json"
        assert "Gaussians" in cli("gsvrinfo", path, "--json", target).out
        assert json.loads(target.read_text())["gops"] == 3
        result = cli("gsvrinfo", path, "--json", target)
        assert result.code == 1
        assert "use -y" in result.err
        assert cli("gsvrinfo", path, "--json", target, "-y").code == 0

    def test_quick_and_light(self, path: Path) -> None:
        code = f"""
import sys
from gsvrcodec.cli.info import main
assert main([{str(path)!r}]) == 0
assert not {{"torch", "cv2", "av", "rich", "PIL"}} & set(sys.modules)
parts = {{name.split(".")[1] for name in sys.modules if name.startswith("gsvrcodec.")}}
assert not {{"encoder", "fit", "video"}} & parts
"""
        subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True)


class TestVerify:
    def test_sound(self, cli: Runner, path: Path) -> None:
        result = cli("gsvrinfo", "--verify", path)
        assert result.code == 0
        assert result.err == "verified: 12 frames in 3 GOPs, all sound\n"

    def test_damaged_fails(self, cli: Runner, path: Path) -> None:
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
        assert cli("gsvrinfo", path).code == 0
        result = cli("gsvrinfo", "--verify", path)
        assert result.code == 3
        assert "chunk GOPD at byte" in result.err

    def test_unfinished_fails(self, cli: Runner, tmp_path: Path) -> None:
        path = making.gsvr_file(tmp_path / "a.gsvr", close=False)
        result = cli("gsvrinfo", path)
        assert result.code == 0
        assert "gsvrinfo: warning: no valid index" in result.err
        assert cli("gsvrinfo", "--verify", path).code == 3

    @pytest.mark.parametrize("content", [b"", b"text\n" * 9])
    def test_other_file_fails(self, cli: Runner, tmp_path: Path, content: bytes) -> None:
        other = tmp_path / "b.gsvr"
        other.write_bytes(content)
        assert f"{other}: not a .gsvr file" in cli.fails(3, "gsvrinfo", other)


class TestReport:
    def test_table(self, cli: Runner, path: Path) -> None:
        result = cli("gsvrreport", making.NOISE, path)
        assert result.code == 0
        assert result.out.startswith("160x120, 12 frames, ")
        assert "PSNR RGB" in result.out

    def test_files(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        files = {name: tmp_path / f"r.{name}" for name in ("json", "csv")}
        options = [f"--{name}={file}" for name, file in files.items()]
        assert cli("gsvrreport", making.NOISE, path, *options).code == 0
        data = json.loads(files["json"].read_text())
        rows = list(csv.DictReader(files["csv"].read_text().splitlines()))
        assert [float(row["psnr_rgb"]) for row in rows] == [
            frame["psnr_rgb"] for frame in data["frames"]
        ]
        assert data["bytes"] == path.stat().st_size
        assert {"bpp", "psnr_rgb", "psnr_rgb_pooled"} <= set(data)
        assert "use -y" in cli.fails(1, "gsvrreport", making.NOISE, path, *options)
        assert cli("gsvrreport", making.NOISE, path, *options, "-y").code == 0

    def test_json_on_standard_output(self, cli: Runner, path: Path) -> None:
        data = json.loads(cli("gsvrreport", making.NOISE, path, "--json", "-").out)
        assert len(data["frames"]) == 12

    def test_both_on_standard_output_fails(self, cli: Runner, path: Path) -> None:
        cli.fails(2, "gsvrreport", making.NOISE, path, "--json", "-", "--csv", "-")

    def test_other_size_fails(self, cli: Runner, path: Path) -> None:
        line = cli.fails(2, "gsvrreport", making.ODD, path)
        assert "give the --crop" in line

    def test_plot(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        assert cli("gsvrreport", making.NOISE, path, "--plot", tmp_path / "p.svg").code == 0
        assert (tmp_path / "p.svg").read_text().startswith("<?xml")

    def test_output_is_input_fails(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        os.link(path, tmp_path / "r.json")
        line = cli.fails(1, "gsvrreport", making.NOISE, path, "--json", tmp_path / "r.json", "-y")
        assert "is the input itself" in line

    def test_against_other_encoders(self, cli: Runner, path: Path, tmp_path: Path) -> None:
        second = making.gsvr_file(tmp_path / "b.gsvr", size=(160, 120), grid=(0, 0, 0))
        target = tmp_path / "rd.json"
        result = cli(
            "gsvrreport", making.NOISE, path, second, "--against", "x264:intra", "--json", target
        )
        assert (result.code, result.err) == (0, "")
        lines = result.out.splitlines()
        assert max(map(len, lines)) <= 80
        assert "against x264 medium all intra:" in lines
        assert "  no BD-rate: the two curves have no PSNR in common" in lines
        rows = [line.split() for line in lines if line.startswith(("a.gsvr", "b.gsvr", "CRF"))]
        data = json.loads(target.read_text())
        assert [float(row[1]) for row in rows[:2]] == [
            pytest.approx(bpp, abs=5e-5) for bpp in (data["bpp"], data["more"][0]["bpp"])
        ]
        assert [float(row[2]) for row in rows[2:]] == [
            pytest.approx(point["bpp"], abs=5e-5) for point in data["against"][0]["points"]
        ]

    def test_damaged_file_of_several_is_named(
        self, cli: Runner, path: Path, tmp_path: Path
    ) -> None:
        damaged = tmp_path / "b.gsvr"
        data = bytearray(path.read_bytes())
        data[len(data) // 2] ^= 1
        damaged.write_bytes(data)
        line = cli.fails(3, "gsvrreport", making.NOISE, path, damaged)
        assert line.startswith(f"{damaged}: chunk GOPD at byte")

    def test_csv_of_several_fails(self, cli: Runner, path: Path) -> None:
        line = cli.fails(2, "gsvrreport", making.NOISE, path, path, "--csv", "-")
        assert "--csv is for one file" in line

    def test_other_encoder_unknown_fails(self, cli: Runner, path: Path) -> None:
        line = cli.fails(2, "gsvrreport", making.NOISE, path, "--against", "x264,vp9")
        assert "--against" in line
        assert "'vp9' is not known: the encoders are x264, x265, svtav1" in line
