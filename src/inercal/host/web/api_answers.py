"""The answers of the read-only interface, with the fields that `interface.toml` declares.

State, estimates and events are those of the page, and a result is that of ``inercal show --json``.
All wall-clock times are ISO 8601 in UTC; all other times are run times in s, which count from the
start of the run, or on a simulated bench are the times of its clock.
"""

from typing import Any

from inercal.basics.documents import record_object
from inercal.calibration.files import calibration_object, load
from inercal.estimation.uncertainty import COVERAGE
from inercal.host.journal import Journal, utc_now
from inercal.host.run_folder import JOURNAL
from inercal.host.web.folders import Runs, StoredRun
from inercal.host.web.hub import Hub
from inercal.host.web.interface import RECORDS, units_of


def state_answer(hub: Hub) -> dict[str, Any]:
    """Return the state of the run in view."""
    phase, plan, state, end = map(hub.latest, ("phase", "plan", "state", "done"))
    shown = {} if plan is None else plan.content
    is_past = end or (state and phase and state.at >= phase.at)
    content = {} if state is None else state.content
    return {
        "at": utc_now(),
        "activity": "active" if hub.is_run_active else "ended" if phase else "idle",
        "run": phase.content["run"] if phase else None,
        "sensor": shown.get("sensor"),
        "plan": shown.get("plan"),
        "operator": hub.people.operator,
        "viewers": len(hub.people.viewers),
        "phase": phase.content["words"] if phase and not is_past else None,
        "received": state.at if state else None,
        "state": {name: content[name] for name in RECORDS["RunState"] if name in content} or None,
        "end": end and {name: end.content[name] for name in RECORDS["RunEnd"]},
        "units": units_of("State"),
    }


def estimates_answer(hub: Hub) -> dict[str, Any]:
    """Return the latest estimates of the run in view."""
    phase, plan, live, end = map(hub.latest, ("phase", "plan", "estimates", "done"))
    listed: list[dict[str, Any]] = plan.content.get("coefficients", []) if plan else []
    known = {str(one["name"]): one for one in listed}
    final: dict[str, Any] | None = end.content.get("final") if end else None
    found: dict[str, Any] = final or (live.content if live else {"values": [], "u2": []})
    names: list[str] = final["names"] if final else list(known)
    units: list[str] = final["units"] if final else [one["unit"] for one in listed]
    rows: Any = zip(names, units, found["values"], found["u2"], strict=False)
    source = end if final else live
    return {
        "at": utc_now(),
        "run": phase.content["run"] if phase else None,
        "source": "calibration" if final else "live" if live else None,
        "received": source.at if source else None,
        "time": found.get("time"),
        "coverage_factor": COVERAGE,
        "coefficients": [
            {
                "name": name,
                "meaning": known.get(name, {}).get("meaning"),
                "unit": unit,
                "value": value,
                "expanded_uncertainty": u2,
            }
            for name, unit, value, u2 in rows
        ],
        "units": units_of("Estimates"),
    }


def runs_answer(runs: Runs) -> dict[str, Any]:
    """Return the stored runs."""
    return {"runs": [run.summary for run in runs.all().values()]}


def journal_answer(run: StoredRun, after: int = 0) -> dict[str, Any]:
    """Return the journal of a run without its first `after` events.

    Raises
    ------
    InputError
        The journal cannot be read.
    """
    with Journal(run.path / JOURNAL, read_only=True) as journal:
        header, events = journal.header(), journal.events(after)
        completed = journal.completed_steps()
    return {
        "run": run.path.name,
        "begun": header.begun,
        "state": run.state,
        "steps": header.steps,
        "completed_steps": completed,
        "events": [{"n": n} | one._asdict() for n, one in enumerate(events, after + 1)],
        "units": units_of("Journal"),
    }


def result_answer(run: StoredRun) -> dict[str, Any]:
    """Return the calibration of a run, as ``inercal show --json`` prints it.

    Raises
    ------
    InputError
        The run has no calibration, or its file cannot be read.
    """
    calibration = load(run.output_file("calibration.json"))
    return {"file": "calibration"} | record_object(calibration_object(calibration))
