"""The robust design of a tube: its orthogonal arrays, and the ratios that follow from its runs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from demos.design import robust_tube


@pytest.mark.parametrize("factors", [3, 7])
def test_in_two_columns_all_pairs_of_levels_occur_equally_often(factors: int) -> None:
    levels = robust_tube.array(factors)
    signs = 2 * levels - 1
    rows = factors + 1
    assert np.array_equal(signs.T @ signs, rows * np.eye(factors))
    assert np.array_equal(signs.sum(axis=0), np.zeros(factors))


@pytest.mark.parametrize("length", list(robust_tube.FACTORS))
def test_a_factor_that_alone_counts_has_all_of_the_variance(
    length: float, monkeypatch: pytest.MonkeyPatch, capsys: Any, tmp_path: Path
) -> None:
    """Responses 1 dB above and below their mean, by the bore of the valve."""

    def outcome(comm: Any, folder: Path, bore: float, **levels: Any) -> dict[str, float]:
        decibels = 1.0 if bore == robust_tube.CONTROL["bore"][1] else -1.0
        assert levels["length"] == length
        return dict.fromkeys(robust_tube.EXPONENTS, 10 ** (-decibels / 20))

    monkeypatch.setattr(robust_tube, "outcome", outcome)
    robust_tube.main(length, tmp_path)
    printed = capsys.readouterr().out
    assert "time [s]: 0.00 dB" in printed
    assert printed.count("bore: -1.00, +1.00 dB, 100 %") == 3
    # Of a stiffness the larger one is the better one.
    assert printed.count("bore: +1.00, -1.00 dB, 100 %") == 1
    assert (tmp_path / "robust_tube.png").read_bytes()[1:4] == b"PNG"
