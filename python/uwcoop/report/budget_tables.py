"""The budget planner's tables: schedule, fields of each packet, other teams, longer slots."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.box import SIMPLE_HEAD
from rich.console import Group, RenderableType
from rich.table import Table

from uwcoop.report.input_tables import budget_table

if TYPE_CHECKING:
    from uwcoop.experiment.packet_budget import Budget, Positioning
    from uwcoop.experiment.packet_contents import Field

__all__ = ["budget_report"]


def budget_report(budget: Budget) -> Group:
    """All that the planner says, 80 columns wide: packets that are the same are shown once."""
    layouts: dict[tuple[Field, ...], list[str]] = {}
    for name, cost in budget.costs.items():
        if cost is not None and cost.fields:
            layouts.setdefault(cost.fields, []).append(name)
    parts: list[RenderableType] = [budget_table(budget)]
    if budget.positioning is not None:
        parts.append(_positioning(budget.positioning))
    parts += [_fields_table(names, fields, budget) for fields, names in layouts.items()]
    if any(budget.costs.values()):
        parts.append(_teams_table(budget))
        if budget.slots:
            parts.append(_slots_table(budget))
    return Group(*parts)


def _positioning(plan: Positioning) -> str:
    return (
        f"Mutual positioning every {plan.interval_s:g} s: a question of one signal and a reply of one signal with "
        f"{plan.reply_bytes} bytes (the landmark's bearing and depth), {plan.air_time_s:.2f} s on the air; "
        f"{plan.per_min:.3g} per minute in the team, {plan.per_min * plan.reply_bytes:.3g} bytes of replies."
    )


def _fields_table(names: list[str], fields: tuple[Field, ...], budget: Budget) -> Table:
    bits = sum(field.total_bits for field in fields)
    tag = f", {budget.tag_bytes} of them the authentication tag" if budget.tag_bytes else ""
    table = _table(
        f"packet of {', '.join(names)}",
        f"{bits} bits = {bits // 8} bytes{tag}. Sender and launch time follow from the slot and cost none.",
    )
    table.add_column("field", no_wrap=True)
    table.add_column("bits", justify="right", no_wrap=True)
    table.add_column("range, step, rounding")
    for field in fields:
        width = str(field.bits) if field.count == 1 else f"{field.count} × {field.bits}"
        table.add_row(field.name, width, field.meaning)
    return table


def _teams_table(budget: Budget) -> Table:
    own = len(budget.heard_per_min)
    table = _table(
        f"teams in slots of {budget.slot_s:g} s",
        "Sends, hears: of and by each vehicle per minute, if none is lost. A packet that needs a longer slot says which; "
        "– fits no slot of this modem.",
    )
    table.add_column("vehicles", justify="right", no_wrap=True)
    for heading in ("cycle\n(s)", "sends\n(1/min)", "hears\n(1/min)"):
        table.add_column(heading, justify="right", no_wrap=True)
    same: dict[tuple[tuple[int | None, float | None], ...], list[str]] = {}
    for name in budget.teams[0].packet_bytes:
        same.setdefault(
            tuple((t.packet_bytes[name], t.slot_needed_s[name]) for t in budget.teams), []
        ).append(name)
    for names in same.values():
        table.add_column("\n".join(names), justify="right")
    for k, team in enumerate(budget.teams):
        cells = [_fit(*sizes[k], budget.slot_s) for sizes in same]
        table.add_row(
            f"{team.vehicles}",
            f"{team.cycle_s:g}",
            f"{team.broadcasts_per_min:.3g}",
            f"{team.heard_per_min:.3g}",
            *cells,
            style="bold" if team.vehicles == own else None,
        )
    return table


def _fit(packet_bytes: int | None, slot_needed_s: float | None, slot_s: float) -> str:
    if packet_bytes is None:
        return "silent"
    if slot_needed_s is None:
        return f"{packet_bytes} B: –"
    if slot_needed_s > slot_s + 1e-9:
        return f"{packet_bytes} B: {slot_needed_s:.2f} s"
    return f"{packet_bytes} B"


def _slots_table(budget: Budget) -> Table:
    table = _table(
        "shortest slots",
        f"Slot = air time + guard {budget.guard_s:.2f} s. The scenario's slot is {budget.slot_s:g} s.",
    )
    for heading in ("frames", "holds\n(B)", "slot\n(s)", "cycle\n(s)", "sends\n(1/min)", "hears\n(1/min)"):
        table.add_column(heading, justify="right", no_wrap=True)
    for plan in budget.slots:
        table.add_row(
            f"{plan.frames}",
            f"{plan.capacity_bytes}",
            f"{plan.slot_s:.2f}",
            f"{plan.cycle_s:.1f}",
            f"{plan.broadcasts_per_min:.3g}",
            f"{plan.heard_per_min:.3g}",
        )
    return table


def _table(title: str, caption: str) -> Table:
    return Table(
        title=title, caption=caption, caption_justify="left", header_style="bold", box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0), pad_edge=False,
    )  # fmt: skip
