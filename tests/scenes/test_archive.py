"""NumPy files: what is written comes back, and no header makes arrays that the file does not hold."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.lib import format as npy

from scenes.archive import load_npy, load_npz, npz_headers


def claiming(shape: tuple[int, ...], descr: str = "<f4", data: bytes = b"") -> bytes:
    """An .npy file whose header says what it likes."""
    file = io.BytesIO()
    npy.write_array_header_1_0(file, {"shape": shape, "fortran_order": False, "descr": descr})
    return file.getvalue() + data


def zipped(path: Path, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(f"{name}.npy", content)
    return path


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    arrays: dict[str, Any] = {"a": np.arange(6.0).reshape(2, 3), "b": np.array(["x", "yy"]), "c": np.float64(2)}
    np.savez_compressed(tmp_path / "x.npz", **arrays)
    back = load_npz(tmp_path / "x.npz")
    assert back.keys() == arrays.keys() and all(np.array_equal(back[name], arrays[name]) for name in arrays)
    headers = npz_headers(tmp_path / "x.npz")
    assert all(headers[name].shape == back[name].shape and headers[name].size == back[name].nbytes for name in back)
    assert load_npz(tmp_path / "x.npz", keys=("b", "z")).keys() == {"b"}
    np.save(tmp_path / "x.npy", arrays["a"])
    assert np.array_equal(load_npy(tmp_path / "x.npy"), arrays["a"])


LIES = {
    "10^12 numbers": (claiming((10**12,)), "4e.03 GB|GB"),
    "more than there is": (claiming((1000,)), "more numbers than it holds"),
    "10^30 numbers without a size": (claiming((10**30,), "<U0"), "GB"),
    "less than nothing": (claiming((-1, -4)), "a shape of"),
    "objects": (claiming((1,), "|O", b"abc"), "pickled Python objects"),
    "version 9": (b"\x93NUMPY\x09\x00" + bytes(100), "version"),
    "no header": (b"what else", "magic"),
    "nothing": (b"", "magic|EOF"),
}


@pytest.mark.parametrize("lie", LIES)
def test_headers_are_not_believed(lie: str, tmp_path: Path) -> None:
    content, words = LIES[lie]
    (tmp_path / "x.npy").write_bytes(content)
    with pytest.raises(ValueError, match=words):
        load_npy(tmp_path / "x.npy")
    if "GB" in words:  # in an archive, what a member holds is known before the sum is taken
        words = "more numbers than it holds"
    with pytest.raises(ValueError, match=words):
        load_npz(zipped(tmp_path / "x.npz", x=content))


def test_what_unpacks_to_more_than_allowed_is_not_unpacked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    zeros = claiming((250_000,), data=bytes(1_000_000))
    path = zipped(tmp_path / "x.npz", a=zeros, b=zeros)
    assert path.stat().st_size < 10_000
    assert load_npz(path, most_bytes=2_000_000)["b"].sum() == 0
    monkeypatch.setattr("scenes.archive._array", lambda file: pytest.fail("an array was made"))
    with pytest.raises(ValueError, match=r"0\.002 GB, and 0\.0015 GB are"):
        load_npz(path, most_bytes=1_500_000)
    with pytest.raises(ValueError, match="it holds 2 arrays"):
        load_npz(path, members=1)


@settings(max_examples=60, deadline=None)
@given(at=st.integers(0, 700), value=st.integers(0, 255), cut=st.integers(0, 700))
def test_damage_is_a_value_error(at: int, value: int, cut: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("x") / "x.npz"
    np.savez(path, a=np.arange(5.0), b=np.array(["x"]))
    content = bytearray(path.read_bytes())
    content[at % len(content)] = value
    path.write_bytes(content[: len(content) - cut % len(content)] if cut % 3 == 0 else content)
    for read in (load_npz, npz_headers, load_npy):
        try:
            read(path)
        except ValueError as error:
            assert str(error)


def test_a_file_that_is_not_there_is_an_os_error(tmp_path: Path) -> None:
    for read in (load_npz, load_npy):
        with pytest.raises(FileNotFoundError):
            read(tmp_path / "none.npz")
