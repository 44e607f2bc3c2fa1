"""Where figures come from."""

from pathlib import Path

from benchmarks.common.origin import cpu_model


def test_the_processor_is_named_as_the_system_names_it(tmp_path: Path) -> None:
    info = tmp_path / "cpuinfo"
    info.write_text("processor\t: 0\nmodel name\t: Fast One 9000\n")
    assert cpu_model(info) == "Fast One 9000"
    assert cpu_model(tmp_path / "nothing")
