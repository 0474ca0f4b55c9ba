"""Tags on packets: every navigator's, off or on, with a key that no output shows."""

from __future__ import annotations

import hashlib
import hmac
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

import uwcoop
from uwcoop import _native
from uwcoop.acoustics.authentication import KeyFileWarning, authenticator_of, check_key
from uwcoop.charts.native import native_chart
from uwcoop.cli import app
from uwcoop.errors import NavigatorError, ScenarioError
from uwcoop.experiment.run import native_mission, replay_for, sample_times_ns
from uwcoop.missionlog.mcap import load_log, write_log
from uwcoop.navigators import NAVIGATORS, Context, Custom, build, options_of
from uwcoop.scenario import MissionSetup, load, parse
from uwcoop.scenario.authentication import Authentication
from uwcoop.scenario.secrets import redact
from uwcoop.world.simulate import simulate

KEY = "00112233445566778899aabbccddeeff"
SHORT = ("duration_s=90", "navigator.all.particles=100")
TAGS = "acoustics.authentication.tag_bytes"


def flown(*settings: str, navigators: Any = ("mpf",), seed: int = 1) -> uwcoop.RunResult:
    return uwcoop.run("flat-bay", list(navigators), seed=seed, overrides=[*SHORT, *settings], clouds=False)


def test_the_tag_is_what_its_documentation_says() -> None:
    key, packet, sender, tol_ns = bytes(range(32)), b"a packet", 2, 9_000_000_000
    derived = hmac.digest(key, b"uwcoop packet tag 1" + bytes([8]) + (77).to_bytes(8, "big"), hashlib.sha256)
    covered = packet + sender.to_bytes(2, "big") + tol_ns.to_bytes(8, "big", signed=True)
    tag = hmac.digest(derived, covered, hashlib.sha256)[:8]
    mine = _native.Authenticator(key, 8, 77)
    assert mine.append_tag(packet, sender, tol_ns) == packet + tag
    assert mine.check_tag(packet + tag, sender, tol_ns) == packet
    assert mine.tag_bytes == 8
    assert mine.check_tag(packet + tag, sender + 1, tol_ns) is None
    assert _native.Authenticator(key, 8, 78).check_tag(packet + tag, sender, tol_ns) is None
    assert "8" not in repr(key) or repr(key) not in repr(mine)
    for key_bytes, tag_bytes in ((15, 8), (65, 8), (32, 0), (32, 17)):
        with pytest.raises(NavigatorError, match=r"bytes in .* is outside"):
            _native.Authenticator(bytes(key_bytes), tag_bytes, 0)


@pytest.mark.parametrize("tag_bytes", [4, 8])
def test_tags_cost_their_bytes_and_change_nothing_else(tag_bytes: int) -> None:
    plain, tagged = flown(), flown(f"{TAGS}={tag_bytes}")
    ours, theirs = (r.summary["navigators"]["mpf"]["packet_bytes"]["max"] for r in (plain, tagged))
    assert theirs == ours - 2 + tag_bytes
    for name in ("position_m", "covariance_m2", "rejected", "heard"):
        np.testing.assert_array_equal(plain.tracks[name], tagged.tracks[name])


def test_a_longer_packet_needs_its_frames_and_gets_lost_with_any_of_them() -> None:
    # 47 bytes fit a frame of 64 with a tag of 8; 26 bytes do not fit the only frame of 32.
    assert flown(f"{TAGS}=8", "navigator.mpf.packet=f64").packets["frames"].max() == 1
    # Two signals of 8 bytes hold 15 bytes, and three a tag of 4 in place of the checksum.
    slow = ("acoustics.modem=aloc", "acoustics.max_range_m=300")
    assert flown(*slow).packets["frames"].max() == 2
    tagged = flown(f"{TAGS}=4", *slow)
    assert set(tagged.packets["frames"].tolist()) == {3}
    assert set(tagged.packets["bytes"].tolist()) == {17}
    assert tagged.packets["received"].sum() < flown(*slow).packets["received"].sum()
    with pytest.raises(
        ScenarioError, match=r"mpf's packet of 17 bytes: slot of 1.60 s is shorter than 3 frames"
    ):
        flown(f"{TAGS}=4", *slow, "acoustics.slot_s=1.6")


def test_navigators_in_python_have_tags_too() -> None:
    seen: list[str] = []

    class Talker:
        def __init__(self, context: Context) -> None:
            self.context = context

        def handle(self, event: _native.Event) -> str:
            if event.kind == "reception":
                seen.append(event.kind)
            return "noted"

        def transmit(self, tol_ns: int, capacity_bytes: int) -> bytes:
            assert capacity_bytes == 64 - 8
            return b"hello"

        def estimate(self, t_ns: int) -> Any:
            return type("E", (), {"mean_m": np.zeros(2), "covariance_m2": np.eye(2)})()

    result = flown(f"{TAGS}=8", navigators=[Custom("talker", Talker)])
    assert set(result.packets["bytes"].tolist()) == {5 + 8}
    assert len(seen) == int(result.packets["received"].sum())


def test_the_same_bits_from_a_snapshot() -> None:
    log = simulate(load("flat-bay", [*SHORT, f"{TAGS}=4"]), 2)
    assert log.chart is not None
    chart, mission, at = native_chart(log.chart), native_mission(log), sample_times_ns(log)
    whole = replay_for(log, mission, "mpf", chart, 0, at)
    whole.run()
    half = replay_for(log, mission, "mpf", chart, 0, at)
    half.run(47_000_000_000)
    rest = replay_for(log, mission, "mpf", chart, 0, at)
    rest.restore(half.snapshot())
    rest.run()
    assert rest.snapshot() == whole.snapshot()
    authenticator = authenticator_of(log)
    assert authenticator is not None
    with pytest.raises(NavigatorError, match="before authentication"):
        whole.authenticate(authenticator)


def test_forged_altered_and_replayed_packets_are_counted_and_change_nothing() -> None:
    log = simulate(load("flat-bay", [*SHORT, f"{TAGS}=4"]), 2)
    authenticator = authenticator_of(log)
    assert authenticator is not None
    context = Context(0, 3, 1500.0, 0, None)
    mine = build("mpf", context, options_of("mpf", log.setup), None).authenticated(0, 3, authenticator)
    start = {"e_m": 0.0, "n_m": 0.0, "cov_ee_m2": 25.0, "cov_en_m2": 0.0, "cov_nn_m2": 25.0}
    mine.handle(_native.Event(0, 0, "fix", **start))
    other = build("mpf", replace(context, vehicle=1), options_of("mpf", log.setup), None)
    other = other.authenticated(1, 3, authenticator)
    other.handle(_native.Event(0, 1, "fix", **start))
    packet = other.transmit(3_000_000_000, 64)
    assert packet is not None

    def hear(bytes_: bytes, tol_ns: int = 3_000_000_000, sender: int = 1) -> str:
        return mine.handle(
            _native.Event(
                4_000_000_000, 0, "reception", sender=sender, tol_ns=tol_ns, toa_ns=tol_ns + 5_000_000,
                bytes=bytes_,
            )
        )  # fmt: skip

    altered = bytes([packet[0] ^ 1]) + packet[1:]
    for said in (hear(altered), hear(packet[:-1]), hear(packet, 3_500_000_000), hear(packet, sender=2)):
        assert said == "rejected"
    assert mine.estimate(0).rejected == 4
    assert hear(packet) != "rejected"
    before = mine.estimate(0).rejected
    assert hear(packet) == "rejected"
    assert mine.estimate(0).rejected == before + 1


def test_no_output_shows_the_key(tmp_path: Path) -> None:
    setting = f'acoustics.authentication.key_hex="{KEY}"'
    tagged = (*SHORT, f"{TAGS}=8", "acoustics.authentication.mission=7")
    result = uwcoop.run("flat-bay", ["mpf"], seed=1, overrides=[*tagged, setting], clouds=False)
    log = result.log
    assert log.team_key == bytes.fromhex(KEY)
    assert log.setup.tables()["acoustics"]["authentication"]["key_hex"] == "**********"
    assert log.setup.authentication.key is None
    assert parse(log.setup.tables()).acoustics.authentication.key is None
    said = [
        repr(log),
        repr(load("flat-bay", [*tagged, setting])),
        json.dumps(result.summary),
        str(result.tracks.attrs),
    ]
    write_log(log, tmp_path / "m.mcap")
    said.append((tmp_path / "m.mcap").read_bytes().decode("latin-1"))
    output = CliRunner()
    run = ["run", "flat-bay", "-n", "mpf", "-o", str(tmp_path / "out")]
    for option in (*tagged, setting):
        run += ["--set", option]
    shown = output.invoke(app, run)
    assert shown.exit_code == 0, shown.output
    assert "every user of this machine can see a key on a command line" in shown.output
    said.append(shown.output)
    files = list((tmp_path / "out").iterdir())
    assert len(files) > 2
    said += [p.read_bytes().decode("latin-1") for p in files]
    for text in said:
        assert KEY not in text
        assert bytes.fromhex(KEY).decode("latin-1") not in text
    # The log can be replayed without it: both ends of its link are simulated.
    back = uwcoop.run(load_log(tmp_path / "m.mcap"), ["mpf"], seed=1, clouds=False)
    np.testing.assert_array_equal(back.tracks["position_m"], result.tracks["position_m"])


@pytest.mark.parametrize(
    "wrong", ['"abcd"', '"zz112233445566778899aabbccddeeff"', "123456789012345678", f'"{KEY}0"']
)
def test_a_key_that_is_none_is_refused_without_repeating_it(wrong: str) -> None:
    with pytest.raises(ScenarioError) as refused:
        load("flat-bay", [f"acoustics.authentication.key_hex={wrong}"])
    assert "hexadecimal digits" in str(refused.value)
    assert wrong.strip('"[]') not in str(refused.value)


STUDY = ("study", "flat-bay", "--runs", "1", "-n", "mpf", "--processes", "1", "-o")


@pytest.mark.parametrize(
    "arguments",
    [
        ("--vary", f"acoustics.authentication.key_hex={KEY},{KEY[::-1]}"),
        ("--vary", f'acoustics.authentication.key_hex="{KEY}"'),
        ("--vary", f'acoustics.authentication={{key_hex="{KEY}", mission=1, tag_bytes=8}}'),
        ("--vary", f"acoustics.authentication.key_hex.{KEY}=1"),
        ("--set", f'acoustics.authentication.key_hex="{KEY}"'),
        ("--set", f'acoustics.authentication={{tag_bytes=8, key_hex="{KEY}"}}'),
        ("--set", f"acoustics.authentication.key_hex={KEY} oops"),
        ("--set", f"acoustics.authentication.key_env={KEY}"),
        ("--set", f'acoustics.authentication.key_env="{KEY}"'),
        ("--set", f'acoustics.authentication.key_env="abcdef{KEY}"'),
        ("--set", f'acoustics.authentication.key_file="{KEY}"'),
        ("--set", f'acoustics.authentication="{KEY}"'),
        ("--set", f'acoustics.authentication.tag_bytes="{KEY}"'),
        ("--set", f"{KEY}"),
        ("--set", f'acoustics.authentication.key_hexx="{KEY}"'),
    ],
)
def test_no_error_and_no_file_of_a_study_repeats_a_key(arguments: tuple[str, str], tmp_path: Path) -> None:
    refused = CliRunner().invoke(app, [*STUDY, str(tmp_path / "out"), *arguments])
    assert refused.exit_code == 2
    assert KEY not in refused.output
    assert KEY[::-1] not in refused.output
    assert not list(tmp_path.iterdir())


@given(
    text=st.text(alphabet="=.{}\"' ab", max_size=20),
    key=st.text(alphabet="0123456789abcdefABCDEF", min_size=32),
)
def test_a_redacted_text_holds_no_key(text: str, key: str) -> None:
    assert key not in redact(f"{text}{key}{text}")
    assert key[:16] not in redact(f"acoustics.authentication.key_hex={text}{key[:16]}")


def test_a_key_in_the_environment_needs_a_name_and_a_mission(monkeypatch: pytest.MonkeyPatch) -> None:
    place = 'acoustics.authentication.key_env="TEAM_KEY"'
    with pytest.raises(
        ScenarioError, match=r"key_env and no mission: must have another number for each mission"
    ):
        load("flat-bay", [f"{TAGS}=8", place])
    tagged = [*SHORT, f"{TAGS}=8", place, "acoustics.authentication.mission=7"]
    with pytest.raises(ScenarioError, match="environment variable TEAM_KEY is not set"):
        uwcoop.run("flat-bay", ["mpf"], overrides=tagged, clouds=False)
    with pytest.raises(ScenarioError, match="environment variable TEAM_KEY is not set"):
        uwcoop.study("flat-bay", 1, ["mpf"], overrides=tagged, processes=1)
    monkeypatch.setenv("TEAM_KEY", KEY)
    uwcoop.run("flat-bay", ["mpf"], overrides=tagged, clouds=False)
    for name in ("1A", "A B", "A=B", ""):
        with pytest.raises(ScenarioError, match="must be the name of an environment variable"):
            load("flat-bay", [f'acoustics.authentication.key_env="{name}"'])


def test_a_key_file_that_others_can_read_is_warned_of(tmp_path: Path) -> None:
    path = tmp_path / "team.key"
    path.write_text(KEY)
    table = {"tag_bytes": 8, "key_file": str(path), "mission": 7}
    plan = Authentication.model_validate(table)
    path.chmod(0o600)
    check_key(plan)
    for mode in (0o640, 0o604):
        path.chmod(mode)
        with pytest.warns(KeyFileWarning, match=r"can be read by other users of this machine: chmod 600"):
            check_key(plan)
    settings = [f"acoustics.authentication.{k}={json.dumps(v)}" for k, v in table.items()]
    args = [sys.executable, "-m", "uwcoop", "run", "flat-bay", "-n", "dead-reckoning"]
    for option in (*SHORT, *settings):
        args += ["--set", option]
    shown = subprocess.run(args, capture_output=True, text=True, timeout=120, check=False)
    assert shown.returncode == 0, shown.stderr
    assert shown.stderr.count("note: key file ") == 1
    assert "Warning" not in shown.stderr
    path.write_text("")
    path.chmod(0o600)
    with pytest.raises(ScenarioError, match="does not hold 32 to 128 hexadecimal digits"):
        check_key(plan)


def test_a_slot_is_deaf_after_four_forgeries() -> None:
    team = _native.Authenticator(bytes(32), 4, 1)
    context = Context(0, 2, 1500.0, 0, None)
    start = {"e_m": 0.0, "n_m": 0.0, "cov_ee_m2": 25.0, "cov_en_m2": 0.0, "cov_nn_m2": 25.0}
    pair = []
    for vehicle in (0, 1):
        navigator = build("mpf", replace(context, vehicle=vehicle), options_of("mpf"), None)
        pair.append(navigator.authenticated(vehicle, 2, team))
        pair[-1].handle(_native.Event(0, vehicle, "fix", **start))
    own, peer = pair
    slots = {tol_s: peer.transmit(tol_s * 1_000_000_000, 64) for tol_s in (1, 2, 3)}

    def hear(tol_s: int, packet: bytes) -> str:
        times = {"tol_ns": tol_s * 1_000_000_000, "toa_ns": tol_s * 1_000_000_000 + 1}
        return own.handle(_native.Event(4_000_000_000, 0, "reception", sender=1, bytes=packet, **times))

    for tol_s, forgeries, heard in ((1, 3, True), (2, 4, False), (3, 0, True)):
        packet = slots[tol_s]
        assert packet is not None
        for k in range(forgeries):
            assert hear(tol_s, bytes([packet[0] ^ (k + 1)]) + packet[1:]) == "rejected"
        assert (hear(tol_s, packet) != "rejected") == heard


def test_a_key_has_one_place() -> None:
    both = ['acoustics.authentication.key_env="A"', 'acoustics.authentication.key_file="b"']
    with pytest.raises(ScenarioError, match="key_env and key_file: the key has one place"):
        load("flat-bay", both)
    with pytest.raises(ScenarioError, match="tag_bytes is 5"):
        load("flat-bay", [f"{TAGS}=5"])


def test_a_key_from_the_environment_or_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mission = "acoustics.authentication.mission=41"
    named = load("flat-bay", [f"{TAGS}=8", mission, 'acoustics.authentication.key_env="TEAM_KEY"'])
    log = simulate(named, 5)
    with pytest.raises(ScenarioError, match="TEAM_KEY is not set"):
        authenticator_of(log)
    monkeypatch.setenv("TEAM_KEY", KEY + "\n")
    from_environment = authenticator_of(log)
    monkeypatch.setenv("TEAM_KEY", "not a key")
    with pytest.raises(ScenarioError, match=r"does not hold 32 to 128 hexadecimal digits") as refused:
        authenticator_of(log)
    assert "not a key" not in str(refused.value)

    (tmp_path / "team.key").write_text(KEY)
    (tmp_path / "team.key").chmod(0o600)
    scenario = tmp_path / "bay.toml"
    text = (Path(uwcoop.__file__).parent / "scenario" / "packaged_scenarios" / "flat-bay.toml").read_text()
    scenario.write_text(
        text + '\n[acoustics.authentication]\ntag_bytes = 8\nkey_file = "team.key"\nmission = 41\n'
    )
    from_file = authenticator_of(simulate(load(scenario), 5))
    assert from_environment is not None
    assert from_file is not None
    tagged = from_environment.append_tag(b"x", 1, 2)
    assert from_file.check_tag(tagged, 1, 2) == b"x"
    (tmp_path / "team.key").unlink()
    with pytest.raises(ScenarioError, match="cannot be read"):
        authenticator_of(simulate(load(scenario), 5))


def test_a_log_of_real_packets_needs_its_key() -> None:
    log = simulate(load("flat-bay", [*SHORT, f"{TAGS}=8"]), 0)
    real = replace(log, payloads=[b"x"])
    with pytest.raises(ScenarioError, match="its key is not given"):
        authenticator_of(real)
    assert log.setup.authentication.tag_bytes == 8
    assert authenticator_of(replace(log, setup=MissionSetup())) is None


def talking(vehicle: int, name: str, setup: MissionSetup, tag: _native.Authenticator) -> _native.Navigator:
    """A native navigator of a team of two after ten ordinary seconds, its packets tagged."""
    context = Context(vehicle, 2, 1500.0, 0, None, (True, False) if name.startswith("deif") else (True, True))
    it = build(name, context, options_of(name, setup), None)
    it.handle(_native.Event(0, vehicle, "fix", **START))
    for second in range(10):
        at = second * 1_000_000_000
        for kind, values in SENSED.items():
            it.handle(_native.Event(at, vehicle, kind, **values))
    return it.authenticated(vehicle, 2, tag)


START = {"e_m": 0.0, "n_m": 0.0, "cov_ee_m2": 25.0, "cov_en_m2": 0.0, "cov_nn_m2": 25.0}
SENSED = {
    "depth": {"depth_m": 2.0, "sigma_m": 0.1},
    "heading": {"yaw_rad": 0.5, "sigma_rad": 0.01},
    "ground_velocity": {"forward_mps": 1.0, "left_mps": 0.0, "sigma_mps": 0.05},
    "motion": {"velocity_e_mps": 0.9, "velocity_n_mps": 0.5},
}
NATIVE = [name for name, spec in NAVIGATORS.items() if not spec.central]


@pytest.mark.parametrize("name", NATIVE)
def test_forged_packets_change_nothing_in_any_navigator(name: str) -> None:
    setup = MissionSetup.of(load("flat-bay", ["navigator.all.particles=20", f"{TAGS}=8"]))
    tag = _native.Authenticator(bytes(range(32)), 8, 5)
    mine, other = talking(0, name, setup, tag), talking(1, name, setup, tag)
    packets = {t: other.transmit(t, 2**31 - 1) for t in (10_000_000_000, 20_000_000_000)}
    known = {t: packet for t, packet in packets.items() if packet is not None}
    before = mine.snapshot()
    rng = np.random.default_rng(7)
    rejected = mine.estimate(10_000_000_000).rejected
    tries = 200
    for _ in range(tries):
        tol_ns = int(rng.choice(list(known))) if known else 10_000_000_000
        packet = bytearray(known.get(tol_ns, bytes(15)))
        match rng.integers(4):
            case 0:
                packet[rng.integers(len(packet))] ^= 1 << rng.integers(8)
            case 1:
                del packet[rng.integers(len(packet)) :]
            case 2:
                packet = bytearray(rng.bytes(int(rng.integers(1, 60))))
            case 3:
                tol_ns += int(rng.integers(1, 1_000_000_000))
        event = _native.Event(
            30_000_000_000, 0, "reception", sender=1, tol_ns=tol_ns, toa_ns=tol_ns + 9_000_000, bytes=bytes(packet)
        )  # fmt: skip
        assert mine.handle(event) == "rejected"
    after = mine.estimate(10_000_000_000)
    assert after.rejected == rejected + tries
    fresh = talking(0, name, setup, tag)
    np.testing.assert_array_equal(after.mean_m, fresh.estimate(10_000_000_000).mean_m)
    np.testing.assert_array_equal(after.covariance_m2, fresh.estimate(10_000_000_000).covariance_m2)
    # Restored from before the assault it takes authentic packets as if nothing had been.
    said: list[list[str]] = [[], []]
    for k, it in enumerate((mine, fresh)):
        it.restore(before)
        for tol_ns, packet in sorted(known.items()):
            event = _native.Event(
                30_000_000_000, 0, "reception", sender=1, tol_ns=tol_ns, toa_ns=tol_ns + 9_000_000, bytes=packet
            )  # fmt: skip
            said[k].append(it.handle(event))
    assert said[0] == said[1]
    assert "rejected" not in said[0][:1]
    assert mine.snapshot() == fresh.snapshot()


@pytest.mark.parametrize(("size", "layout"), [(8, 2), (16, 1), (32, 1), (32, 2)])
def test_exchange_packets_of_every_layout_carry_tags(size: int, layout: int) -> None:
    """Checks of their own stay in the packet, beside the tag."""
    packet = (
        f"navigator.landmark.packet_bytes={size}",
        f"navigator.landmark.packet_format={layout}",
        "duration_s=400",
    )
    plain = uwcoop.run("seafloor-survey", ["landmark"], seed=1, overrides=packet, clouds=False)
    key = 'acoustics.authentication={tag_bytes=4, mission=7, key_hex="000102030405060708090a0b0c0d0e0f"}'
    tagged = uwcoop.run("seafloor-survey", ["landmark"], seed=1, overrides=(*packet, key), clouds=False)
    lengths = [np.unique(r.packets["bytes"][r.packets["accepted"]]) for r in (plain, tagged)]
    own_check = size == 8 or layout == 1
    assert lengths[0].tolist() == [size]
    assert lengths[1].tolist() == [size + 4 - (0 if own_check else 2)]
