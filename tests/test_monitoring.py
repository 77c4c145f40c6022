"""configs/monitoring: Prometheus takes its files, alerts fire when they should, and every metric that they name exists."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from bridge.bus.certificate_metric import ENDS
from bridge.ingest.health import BridgeHealth
from bridge.wire.messages import Quality
from estimator.service.health import Note, ServiceHealth

ROOT = Path(__file__).parent.parent
FOLDER = ROOT / "configs/monitoring"
FILES = sorted(FOLDER.iterdir())

#: an alert, series that fire it after an hour, and series that must not
CASES = {
    "TruerateProgramDown": ('up{job="truerate"}', "0x60", "1x60"),
    "TruerateRouterGone": ("truerate_bus_connected", "0x60", "1x60"),
    "TruerateLoopStuck": ("truerate_loop_age_seconds", "60x60", "0.1x60"),
    "TruerateOverloaded": ("truerate_busy_ratio", "0.97x60", "0.5x60"),
    "TruerateStoreFailing": ("truerate_store_writable", "0x60", "1x60"),
    "TruerateSamplesUnaccounted": ("truerate_law_violations_all_total", "0+1x60", "3x60"),
    "TruerateCertificateEnds": ("truerate_certificate_ends_timestamp_seconds", "604800x60", "8640000x60"),
    "TruerateDeviceSilent": ('truerate_bridge_device_connected{device="d"}', "0x60", "1x60"),
    "TruerateNeedsPerson": ('truerate_needs_person{device="d"}', "1x60", "0x40 1x10 0x10"),
    "TruerateSamplesLost": ('truerate_samples_missing_total{device="d"}', "0+300x60", "0+10x60"),
    "TruerateLate": ('truerate_latency_seconds{device="d"}', "5x60", "0.05x60"),
    "TruerateDegraded": ('truerate_quality{device="d",quality="degraded"}', "1x60", "_x60"),
    "TruerateFilterInconsistent": ('truerate_nis{device="d"}', "9x90", "1.1x90"),
    "TruerateBatteryLow": ('truerate_bridge_battery_percent{device="d"}', "12x60", "40x60"),
}
#: samples that arrive meanwhile
IN = {"series": 'truerate_samples_in_total{device="d"}', "values": "0+6000x90"}


def dashboard() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((FOLDER / "dashboard.json").read_text(encoding="utf-8"))
    return found


def expressions() -> list[str]:
    """Those of the dashboard's panels, for every ward and device."""
    found = [target["expr"] for panel in dashboard()["panels"] for target in panel["targets"]]
    return [one.replace("$ward", ".*").replace("$device", ".*") for one in found]


def promtool(*words: str) -> None:
    """Run promtool; it must be content."""
    found = shutil.which("promtool")
    if found is None:
        pytest.skip("there is no promtool here; `apt-get install prometheus` brings it")
    ran = subprocess.run([found, *words], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr


@pytest.mark.parametrize("path", [one for one in FILES if one.suffix in {".json", ".yml"}], ids=lambda one: one.name)
def test_each_metric_that_is_named_exists(path: Path) -> None:
    service = ServiceHealth()
    service.note(Note(time_s=0.0, connected=True, store=""))
    bridge = BridgeHealth(infos=tuple, turned_s=lambda: 0.0, connected=lambda: True)
    families = [*service.families(), *bridge.families(), ENDS]
    known = {f"truerate_{one.name}{'_total' if one.counter else ''}" for one in families}
    text = path.read_text(encoding="utf-8")
    assert set(re.findall(r"\btruerate_\w+", text)) <= known
    assert set(re.findall(r"quality=\W+(\w+)", text)) <= {one.name.lower() for one in Quality}


def test_prometheus_takes_the_files_and_each_expression_of_the_dashboard(tmp_path: Path) -> None:
    promtool("check", "config", str(FOLDER / "prometheus.yml"))
    rules = [{"record": f"panel:{n}", "expr": one} for n, one in enumerate(expressions())]
    (tmp_path / "panels.yml").write_text(json.dumps({"groups": [{"name": "panels", "rules": rules}]}), encoding="utf-8")
    promtool("check", "rules", str(tmp_path / "panels.yml"))


def test_each_alert_fires_when_it_should_and_not_otherwise(tmp_path: Path) -> None:
    named = re.findall(r"alert: (\w+)", (FOLDER / "rules.yml").read_text(encoding="utf-8"))
    assert [name for name in CASES if name not in named] == []
    cases = [
        {
            "interval": "1m",
            "input_series": [{"series": series, "values": values}, IN],
            "promql_expr_test": [
                {
                    "expr": f'count(ALERTS{{alertname="{name}",alertstate="firing"}}) or vector(0)',
                    "eval_time": "1h",
                    "exp_samples": [{"labels": "{}", "value": int(fires)}],
                }
            ],
        }
        for name, (series, bad, fine) in CASES.items()
        for fires, values in ((True, bad), (False, fine))
    ]  # fmt: skip
    made = {"rule_files": [str(FOLDER / "rules.yml")], "evaluation_interval": "1m", "tests": cases}
    (tmp_path / "test.yml").write_text(json.dumps(made), encoding="utf-8")
    promtool("test", "rules", str(tmp_path / "test.yml"))


def test_the_dashboard_is_one_that_grafana_imports() -> None:
    found = dashboard()
    assert found["uid"]
    assert found["schemaVersion"] >= 36
    panels = found["panels"]
    assert len({panel["id"] for panel in panels}) == len(panels)
    taken = set[tuple[int, int]]()
    for panel in panels:
        grid = panel["gridPos"]
        cells = {
            (x, y) for x in range(grid["x"], grid["x"] + grid["w"]) for y in range(grid["y"], grid["y"] + grid["h"])
        }
        assert grid["x"] + grid["w"] <= 24, "Grafana has 24 columns"
        assert not taken & cells, f"{panel['title']} covers another panel"
        taken |= cells
    variables = {one["name"] for one in found["templating"]["list"]}
    assert set(re.findall(r"\$\{?(\w+)", json.dumps(panels))) <= variables


def test_the_picture_shows_the_panels() -> None:
    drawn = re.sub(r"<[^>]*>", "\n", (ROOT / "docs/images/monitoring.svg").read_text(encoding="utf-8"))
    missing = [panel["title"] for panel in dashboard()["panels"] if panel["title"] not in drawn]
    assert not missing, f"run docs/monitoring_picture.py: {missing}"
