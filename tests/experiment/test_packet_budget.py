"""The budget planner: what it says is what the encoders do and what the schedule enforces."""

from __future__ import annotations

import io
from typing import Any

import pytest
from rich.console import Console

import uwcoop
from uwcoop import acoustics
from uwcoop.errors import ScheduleError
from uwcoop.experiment.packet_budget import Budget, budget
from uwcoop.experiment.packet_contents import packet_bytes, packet_fields
from uwcoop.navigators import NAVIGATORS
from uwcoop.report.budget_tables import budget_report
from uwcoop.scenario import MissionSetup, load
from uwcoop.world.simulate import simulate

TAGS = "acoustics.authentication.tag_bytes"


def planned(*settings: str, navigators: Any = None) -> Budget:
    return budget(load("flat-bay", settings), navigators)


def rendered(found: Budget, width: int = 80) -> str:
    console = Console(width=width, file=io.StringIO(), record=True)
    console.print(budget_report(found))
    return console.export_text()


@pytest.mark.parametrize("tag_bytes", [0, 4, 8])
@pytest.mark.parametrize("name", list(NAVIGATORS))
def test_the_fields_of_every_packet_add_up(name: str, tag_bytes: int) -> None:
    tables = load("flat-bay", ["acoustics.modem=unlimited", f"{TAGS}={tag_bytes}"]).resolved()
    if name.startswith("deif"):  # a one-way method: one vehicle alone uses ranges
        tables["vehicles"] = [{"fuses_ranges": k == 1} for k in range(3)]
    setup = MissionSetup.parse(tables)
    size = packet_bytes(name, setup, 3, acoustics.NO_LIMIT_BYTES)
    fields = packet_fields(name, setup, 3, acoustics.NO_LIMIT_BYTES)
    if size is None:
        assert fields == ()
        return
    assert sum(field.total_bits for field in fields) == 8 * size
    tags = [field.bits for field in fields if field.name == "authentication tag"]
    assert tags == ([8 * tag_bytes] if tag_bytes else [])


def test_a_tag_costs_its_bytes_and_no_more() -> None:
    plain, tagged = (
        planned(navigators=["mpf"]).costs["mpf"],
        planned(f"{TAGS}=8", navigators=["mpf"]).costs["mpf"],
    )
    assert plain is not None
    assert tagged is not None
    assert tagged.packet_bytes == plain.packet_bytes - 2 + 8  # the checksum's place
    assert tagged.fields[:-1] == plain.fields[:-1]
    assert plain.fields[4].meaning == "-32768 to 32767.9 m, steps of 0.0625 m, rounded to the nearest"


def test_a_tag_that_does_not_fit_the_frame_is_refused_with_the_arithmetic() -> None:
    slow = ("acoustics.modem=aloc", "acoustics.max_range_m=300", "acoustics.slot_s=1.6")
    plain = planned(*slow, navigators=["mpf"]).costs["mpf"]
    assert plain is not None
    assert (plain.packet_bytes, plain.frames) == (15, 2)
    with pytest.raises(
        ScheduleError, match=r"mpf's packet of 17 bytes: slot of 1.60 s is shorter than 3 frames"
    ):
        planned(*slow, f"{TAGS}=4", navigators=["mpf"])


def test_cycles_of_other_teams_and_slots() -> None:
    found = planned(navigators=["dead-reckoning", "dmpf", "mpf"])
    teams = {team.vehicles: team for team in found.teams}
    assert sorted(teams) == [2, 3, 4, 5, 8, 12, 16]
    assert teams[3].cycle_s == found.cycle_s == 9
    assert teams[3].heard_per_min == pytest.approx(next(iter(found.heard_per_min.values())))
    assert teams[16].broadcasts_per_min == pytest.approx(60 / 48)
    assert teams[16].heard_per_min == pytest.approx(15 * 60 / 48)
    assert teams[8].packet_bytes == {"dmpf": 15, "mpf": 15}
    assert [plan.frames for plan in found.slots] == [1, 2, 3]
    for plan in found.slots:
        assert plan.slot_s == pytest.approx(0.3 + plan.frames * 64 * 8 / 250 + 950 / 1500)
        scheduled = simulate(
            load("flat-bay", [f"acoustics.slot_s={plan.slot_s + 1e-5:.6f}", "duration_s=90"]), 0
        )
        assert (scheduled.slots["capacity_bytes"] == plan.capacity_bytes).all()
        shorter = load("flat-bay", [f"acoustics.slot_s={plan.slot_s - 0.01:.6f}", "duration_s=90"])
        if plan.frames == 1:
            with pytest.raises(ScheduleError):
                simulate(shorter, 0)
        else:
            assert (simulate(shorter, 0).slots["capacity_bytes"] < plan.capacity_bytes).all()


def test_the_report_fits_eighty_columns_and_says_what_is_asked() -> None:
    text = rendered(planned(f"{TAGS}=4", navigators=["dead-reckoning", "dmpf", "mpf"]))
    assert "…" not in text
    assert max(len(line) for line in text.splitlines()) <= 80
    for piece in (
        "packet of dmpf, mpf", "authentication tag", "136 bits = 17 bytes, 4 of them", "cycle 9 s", "guard 0.63 s",
        "teams in slots of 3 s", "shortest slots", "0 to 13004.8 m",
    ):  # fmt: skip
        assert piece in " ".join(text.split())
    silent = rendered(planned(navigators=["dead-reckoning"]))
    assert "packet of" not in silent
    unlimited = rendered(planned("acoustics.modem=unlimited", navigators=["dmpf-unlimited"]))
    assert "600 × 64" in unlimited
    assert "shortest slots" not in unlimited


@pytest.mark.parametrize(("tag_bytes", "size", "signals"), [(0, 32, 4), (4, 34, 5), (8, 38, 5)])
def test_exchange_packets_show_their_fields_and_the_signals_that_a_tag_adds(
    tag_bytes: int, size: int, signals: int
) -> None:
    found = budget(load("seafloor-survey", [f"{TAGS}={tag_bytes}"]))
    assert found.costs["dead-reckoning-dvl"] is None
    for name in ("landmark-paper", "landmark-ekf", "landmark"):
        cost = found.costs[name]
        assert cost is not None
        assert (cost.packet_bytes, cost.frames) == (size, signals)
        assert sum(field.total_bits for field in cost.fields) == 8 * size
        assert {"landmark x", "partial correlation"} <= {field.name for field in cost.fields}
    assert found.positioning is not None
    assert (found.positioning.reply_bytes, found.positioning.signals) == (4, 2)
    text = " ".join(rendered(found).split())
    assert "positioning every 10 s" in text
    assert ("authentication tag" in text) == (tag_bytes > 0)


@pytest.mark.parametrize(("size", "sent"), [(8, 8), (16, 16), (40, 40), (64, 32), (128, 32)])
def test_every_size_of_exchange_packet_adds_up_and_one_mode_takes_the_shortest_that_holds_it(
    size: int, sent: int
) -> None:
    setup = MissionSetup.of(load("seafloor-survey", [f"navigator.landmark.packet_bytes={size}"]))
    fields = packet_fields("landmark", setup, 2, acoustics.NO_LIMIT_BYTES)
    assert sum(field.total_bits for field in fields) == 8 * sent


@pytest.mark.parametrize(("modem", "tag_bytes", "size"), [
    ("micromodem-32", 0, 32), ("micromodem-32", 4, 24), ("micromodem-32", 8, 28), ("micromodem-64", 4, 34),
])  # fmt: skip
def test_an_origin_packet_whose_frame_is_full_gives_its_exact_lag_up_for_a_tag(
    modem: str, tag_bytes: int, size: int
) -> None:
    spoken = ('acoustics.packet="32"', f'acoustics.modem="{modem}"', f"{TAGS}={tag_bytes}")
    found = budget(load("ship-and-auv", spoken), ["mdeif"]).costs["mdeif"]
    assert found is not None
    assert (found.packet_bytes, found.frames) == (size, 1)
    flown = uwcoop.run("ship-and-auv", ["mdeif"], seed=0, overrides=(*spoken, "duration_s=400"), clouds=False)
    assert flown.tracks.packet_bytes.values.max() == size
