"""What stands on which page of docs/results/: scenarios, navigators, numbers of runs, and what they mean."""

from __future__ import annotations

from dataclasses import dataclass

ALL = "dead-reckoning,ranging-only,terrain-only,dmpf,mpf-terrain-only,mpf"


@dataclass(frozen=True)
class Study:
    """One table."""

    title: str
    scenario: str
    runs: int
    navigators: str = ALL
    options: tuple[str, ...] = ()
    note: str = ""
    before: str = ""
    """A command that comes first."""
    slug: str = ""
    """Name of its folder."""


@dataclass(frozen=True)
class Page:
    """One page: its tables, top to bottom."""

    title: str
    intro: str
    studies: tuple[Study, ...]


SCENARIOS = Page(
    "The scenarios",
    "The packaged missions with all navigators that send Micromodem frames of 64 bytes or nothing. How to read the "
    "tables: [Results](index.md).",
    (
        Study("Rich terrain, no current (`st-john`)", "st-john", 40, slug="st-john"),
        Study("A current that is a random walk (`st-john-drift`)", "st-john-drift", 40, slug="st-john-drift"),
        Study(
            "Hardly any relief (`flat-bay`)",
            "flat-bay",
            40,
            note="Relief × 0.15 and 20 % loss: a broadcast estimate contains earlier estimates of its "
            "receiver, and D-MPF becomes overconfident at wrong positions.",
            slug="flat-bay",
        ),
        Study(
            "Hardly any relief and poor sensors (`poor-bay`)",
            "poor-bay",
            40,
            note="0.5 m of relief, 0.3 m depth noise, unknown tide, current and biases, 20 % loss.",
            slug="poor-bay",
        ),
        Study(
            "Number of particles",
            "st-john-drift",
            20,
            "mpf",
            ("--vary", "navigator.all.particles=300,600,1500"),
            slug="particles",
        ),
        Study(
            "Novelty of a teammate's ranges",
            "flat-bay",
            40,
            "mpf",
            (
                "--vary",
                "navigator.mpf.range_novelty=true,false",
                "--vary",
                "navigator.mpf.range_temper=0.1,0.5,1.0",
            ),
            note="Repeated fused estimates of one sender are correlated: at full weight they make the team "
            "overconfident. With `range_novelty` the weight of a range is the independent part of the "
            "sender's error since its last packet, times "
            "`range_temper`, which is 0.5 by default in a team of three; without it, `range_temper` alone decides.",
            slug="news",
        ),
    ),
)

REAL_SOUNDINGS = Page(
    "Charts that are wrong, and real soundings",
    "Real charts err by metres, over tens of metres at a time. First a simulated survey, then a public multibeam chart "
    "of a seabed without enough relief for localisation, then teams on real tracks and soundings.",
    (
        Study(
            "A surveyed chart (`surveyed-bay`)",
            "surveyed-bay",
            20,
            "dead-reckoning,dmpf,mpf-terrain-only,mpf",
            note="`st-john-drift` through a chart made by a simulated survey, a new one for each mission.",
            slug="surveyed-bay",
        ),
        Study(
            "The same with a likelihood that treats the chart's errors as white noise",
            "surveyed-bay",
            20,
            "mpf-terrain-only,mpf",
            ("--set", "navigator.all.correlation_length_m=0"),
            slug="surveyed-bay-white",
        ),
    ),
)

PAGES = {"scenarios": SCENARIOS, "real-soundings": REAL_SOUNDINGS}
