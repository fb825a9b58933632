"""What the command lines refuse before they compute anything."""

import pytest

from beamrider.io.arguments import part_of
from beamrider.io.files import InputError, check_out
from optics.waves.incidence import check_range
from tests.processes import main_of


def test_outputs_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    check_out(tmp_path / "new" / "deep" / "t.h5")
    assert not (tmp_path / "new").exists()
    for out, why in ((tmp_path, "not a folder"), (tmp_path / "file" / "t.h5", "is not a folder"), ("", "not a folder")):
        with pytest.raises(InputError, match=why):
            check_out(out)


@pytest.mark.parametrize("bounds", [(-0.1, 0.1), (1.2, 0.1), (0.1, -0.1), (0.1, 0.0), (0.8, 0.7), (float("nan"), 0.1)])
def test_ranges_beyond_the_light(bounds):
    with pytest.raises(InputError, match="-max = "):
        check_range(1.0, *bounds)
    check_range(1.0, 0.6, 0.6)


@pytest.mark.parametrize("tolerance", ["0", "-1", "nan", "inf", "2"])
@pytest.mark.parametrize("module", ["thin_film", "modal", "nodes", "fdtd"])
def test_tolerances_that_make_no_sense(module, tolerance, tmp_path, monkeypatch):
    arguments = [module, "--cell", "none.yaml", "--out", str(tmp_path / "t.h5"), "--tolerance", tolerance]
    monkeypatch.setattr("sys.argv", arguments)
    with pytest.raises(InputError, match="--tolerance = "):
        main_of(f"optics.{module}")()


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b", "1/2/3", "-1/2", "+1/2", "1/", ""])
def test_a_part_that_is_none_is_refused(text):
    with pytest.raises(InputError, match=r"--block = .*: must be i/n with 1 ≤ i ≤ n"):
        part_of("--block", text)
    assert part_of("--part", "3/8") == (3, 8)
