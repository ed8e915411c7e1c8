"""Limits from the environment, and what each error class is."""

from __future__ import annotations

import pickle

import pytest

from gsvrcodec import errors
from gsvrcodec.limits import Limits


class TestLimits:
    def test_are_the_defaults_without_variables(self) -> None:
        assert Limits.from_environment({"OTHER": "1"}) == Limits()

    def test_are_overridden_by_variables(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("GSVR_LIMIT_WIDTH", "99")
        assert Limits.from_environment() == Limits(width=99)

    @pytest.mark.parametrize("text", ["", "0", "-1", "1.5", "many", "1e3", "٣", "9" * 20])
    def test_a_variable_that_is_no_number_fails(self, text: str) -> None:
        with pytest.raises(errors.UsageError, match="GSVR_LIMIT_WIDTH must be a whole number"):
            Limits.from_environment({"GSVR_LIMIT_WIDTH": text})

    def test_are_inclusive(self) -> None:
        Limits(width=5).check("width", 5, "the width")
        with pytest.raises(errors.LimitError, match="the width is 6, over the limit of 5"):
            Limits(width=5).check("width", 6, "the width")

    def test_of_expansion_grow_with_the_payload(self) -> None:
        limits = Limits(expansion_base=100, expansion_ratio=10)
        limits.check_expansion(120, 2)
        with pytest.raises(errors.LimitError, match="over the limit of 120"):
            limits.check_expansion(121, 2)


class TestErrors:
    @pytest.mark.parametrize(
        ("error", "exit_code", "builtin"),
        [
            (errors.InputError, 1, OSError),
            (errors.OutputError, 1, OSError),
            (errors.AddressError, 1, OSError),
            (errors.WorkerError, 1, RuntimeError),
            (errors.UsageError, 2, ValueError),
            (errors.NotAVideoError, 3, ValueError),
            (errors.CorruptError, 3, ValueError),
            (errors.NotGsvrError, 3, ValueError),
            (errors.UnsupportedError, 4, ValueError),
            (errors.LimitError, 4, ValueError),
            (errors.VerificationError, 6, ValueError),
        ],
    )
    def test_have_their_exit_code_and_resemble_a_builtin(
        self, error: type[errors.GsvrError], exit_code: int, builtin: type[Exception]
    ) -> None:
        assert error.exit_code == exit_code
        assert issubclass(error, errors.GsvrError)
        assert issubclass(error, builtin)
        assert str(error("what")) == "what"

    def test_corruption_names_chunk_and_offset(self) -> None:
        assert (
            str(errors.CorruptError("bad", chunk="GOPD", offset=9)) == "chunk GOPD at byte 9: bad"
        )
        assert str(errors.CorruptError("bad", offset=9)) == "at byte 9: bad"
        assert str(errors.CorruptError("bad", chunk="GOPD")) == "chunk GOPD: bad"

    def test_a_place_is_added_where_it_is_not_known(self) -> None:
        located = errors.NotGsvrError("bad", offset=3).located("HEAD", 8)
        assert isinstance(located, errors.NotGsvrError)
        assert (located.chunk, located.offset) == ("HEAD", 3)

    def test_corruption_survives_a_process_border(self) -> None:
        error = pickle.loads(pickle.dumps(errors.CorruptError("bad", chunk="GOPD", offset=9)))
        assert str(error) == "chunk GOPD at byte 9: bad"
        assert (error.message, error.chunk, error.offset) == ("bad", "GOPD", 9)
