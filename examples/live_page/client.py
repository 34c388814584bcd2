"""Read the live page from a script: print the state, wait for the end of the run, keep the result.

    python client.py http://127.0.0.1:8765 --out results

The read-only token is read from the environment variable INERCAL_READ_TOKEN, because other users of
a machine can see the arguments of a command. A server on this machine may need no token. Only the
standard library is used. The page https://spec.openapis.org/oas/v3.1.1 explains the description at
/api/openapi.json, from which other clients can be generated.
"""

import argparse
import json
import os
import sys
import time
from pathlib import Path
from typing import Any
from urllib.error import HTTPError
from urllib.parse import quote
from urllib.request import Request, urlopen

TIMEOUT = 20.0  # s for one answer
INTERFACE = "1"  # first number of the version of the interface that this client understands


class RequestRefused(Exception):
    """A refusal of the server, with its status code and its words."""

    def __init__(self, status: int, words: str):
        super().__init__(f"status {status}: {words}")
        self.status = status


class PageClient:
    """A client of the live page that only reads.

    Parameters
    ----------
    address : str
        Address of the page, such as "http://127.0.0.1:8765".
    token : str, optional
        The read-only token.
    """

    def __init__(self, address: str, token: str = ""):
        self._address, self._token = address.rstrip("/"), token

    def request(self, method: str, path: str, body: bytes | None = None) -> bytes:
        """Send a request, and return the body of the answer.

        Raises
        ------
        RequestRefused
            The server refuses the request.
        OSError
            The server does not answer.
        """
        asked = Request(self._address + path, body, method=method)
        if self._token:
            asked.add_header("Authorization", f"Bearer {self._token}")
        try:
            with urlopen(asked, timeout=TIMEOUT) as answer:
                return answer.read()
        except HTTPError as error:
            with error:
                words = error.read().decode(errors="replace").strip()
            if error.headers.get_content_type() == "text/html":  # the form for a browser
                words = "set INERCAL_READ_TOKEN to the read-only token of the server"
            raise RequestRefused(error.code, words) from None

    def get(self, path: str) -> Any:
        """Return the JSON content at a path."""
        return json.loads(self.request("GET", path))


def print_overview(client: PageClient) -> None:
    """Print the version of the interface, the plans, and the stored runs."""
    version = client.get("/api/openapi.json")["info"]["version"]
    if version.split(".")[0] != INTERFACE:
        print(f"the server has version {version} of the interface, this client {INTERFACE}")
    setup = client.get("/api/setup")
    print("plans:", ", ".join(one["id"] for one in setup["plans"]))
    for run in client.get("/api/runs")["runs"]:
        print(f"run {run['id']}: {run['state']}, begun {run['begun']}, sensor {run['sensor']}")


def print_state(client: PageClient) -> dict[str, Any]:
    """Print the state of the run and its estimates with U, and return the state."""
    shown = client.get("/api/state")
    print(f"{shown['at']}: {shown['activity']}, run {shown['run']}, operator {shown['operator']}")
    if state := shown["state"]:
        unit = shown["units"]
        print(f"  time {state['time']} {unit['time']}, {state['done']} steps completed")
        for number, axis in enumerate((state["table"] or {"axes": []})["axes"], 1):
            print(f"  axis {number}: {axis['angle']} {unit['angle']}, {axis['state']}")
    found = client.get("/api/estimates")
    for one in found["coefficients"]:
        value, uncertainty = one["value"], one["expanded_uncertainty"]
        print(f"  {one['name']} = {value} {one['unit']}, U = {uncertainty or 'unknown'}")
    return shown


def wait_for_end(client: PageClient, interval: float) -> dict[str, Any]:
    """Print new events until the run has ended, and return the last state.

    Parameters
    ----------
    client : PageClient
    interval : float
        Time between two requests, s.
    """
    printed = 0
    while True:
        shown = client.get("/api/state")
        if shown["run"] is not None:
            printed = print_events(client, shown["run"], printed)
        if shown["activity"] != "active":
            return shown
        time.sleep(interval)


def print_events(client: PageClient, run: str, after: int) -> int:
    """Print the events of a run after a number, and return the number of the last event."""
    try:
        journal = client.get(f"/api/runs/{quote(run, safe='')}/journal?after={after}")
    except RequestRefused as error:
        if error.status != 404:  # a run has no journal while its process starts
            raise
        return after
    for event in journal["events"]:
        print(f"  {event['at']} {event['level']}: {event['words']}")
    return after + len(journal["events"])


def save_result(client: PageClient, run: str, folder: Path) -> None:
    """Write the result, the journal and the report of a run; existing files are not changed.

    Raises
    ------
    FileExistsError
        The folder already exists.
    """
    name = quote(run, safe="")
    files = {
        "result.json": f"/api/runs/{name}/result",
        "journal.json": f"/api/runs/{name}/journal",
        f"{run}.calibration.json": f"/runs/{name}/calibration",
        f"{run}.report.html": f"/runs/{name}/report",
    }
    contents = {file: client.request("GET", path) for file, path in files.items()}
    folder.mkdir(parents=True)
    for file, content in contents.items():
        (folder / file).write_bytes(content)
    result = json.loads(contents["result.json"])
    print(f"saved in {folder}: {len(result['coefficients'])} coefficients of {run}")


def main(arguments: list[str] | None = None) -> int:
    """Print the state, wait for the end of the run, save its result, and return the exit status."""
    parser = argparse.ArgumentParser(description="Read the live page of inercal.")
    parser.add_argument("address", help="address of the page, such as http://127.0.0.1:8765")
    parser.add_argument("--out", type=Path, help="new folder for the result")
    parser.add_argument("--interval", type=float, default=1.0, help="s between two requests")
    given = parser.parse_args(arguments)
    client = PageClient(given.address, os.environ.get("INERCAL_READ_TOKEN", ""))
    if given.out is not None and given.out.exists():
        parser.error(f"{given.out} exists already; name a new folder")
    try:
        print_overview(client)
        shown = print_state(client)
        if shown["run"] is None:
            print("no run is active")
            return 0
        end = wait_for_end(client, given.interval)["end"]
        print_state(client)
        print(f"the run has ended: {end['state']}, {end['words']}")
        if given.out is not None and end["state"] == "done":
            save_result(client, end["run"], given.out)
    except (RequestRefused, OSError) as error:
        print(f"client: {given.address}: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
