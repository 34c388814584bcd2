"""Options, places to write and arguments that no verb can use."""

from tests.bad_inputs.bad_input import BadInput, swap

TABLE = "pmac://127.0.0.1:1?motors=1,2,3&counts=3600000"
BENCH = f"bench run @mimu.toml --table {TABLE} --imu tcp://127.0.0.1:1?preset=xsens --out @new"
INIT = ("init", "-y", "@log.csv", "--out", "@new.toml", "--set")


def refused(command: str | tuple[str, ...], *words: str) -> BadInput:
    return BadInput(command, words)


CASES: dict[str, BadInput] = {
    "calibrate two run files": refused("calibrate @run.toml @imu.toml", "imu.toml"),
    "calibrate into a file": refused("calibrate @run.toml --out @log.csv", "log.csv"),
    "calibrate, mistyped option": refused("calibrate @run.toml --output @", "--output", "--out"),
    "calibrate, a register of nowhere": refused(
        "calibrate @run.toml --out @new --register @no/reg.db", "no/reg.db"
    ),
    "report as PDF": refused("report @run.toml --out @page.pdf", "page.pdf", ".html"),
    "report onto the recording": refused("report @run.toml --out @log.csv", "log.csv", "input"),
    "simulate, negative seed": refused("simulate @run.toml --out @x.csv --seed -1", "--seed"),
    "simulate, seed of letters": refused("simulate @run.toml --out @x.csv --seed x", "--seed"),
    "simulate onto the run file": refused("simulate @run.toml --out @run.toml --force", "run.toml"),
    "simulate, more than a disk holds": BadInput(
        "simulate @run.toml --out @x.csv",
        ("run.toml", "seconds"),
        {"run.toml": swap('seconds = "4 s"', 'seconds = "1e9 s"')},
    ),
    "simulate means": refused("simulate @means.toml --out @x.csv", "means.toml", "[data] rate"),
    "budget, no workers": refused("budget @run.toml --workers 0 --out @", "--workers"),
    "budget, workers of letters": refused("budget @run.toml --workers x --out @", "--workers"),
    "budget, one trial": refused("budget @run.toml --trials 1 --out @", "--trials"),
    "budget into a file": refused("budget @run.toml --out @log.csv", "log.csv"),
    "demo, negative seed": refused("demo --seed -1 --out @new", "--seed"),
    "noise, unknown method": refused("noise @log.csv --method best", "--method", "gmwm"),
    "noise, terms that do not exist": refused("noise @run.toml --terms XY", "XY"),
    "noise onto an input": refused("noise @run.toml --write @run.toml", "run.toml"),
    "reproduce, no trials": refused("reproduce centrifuge --trials 0 --out @", "0 trials"),
    "reproduce two": refused("reproduce centrifuge turntable --out @", "turntable"),
    "plan of a recording": refused("plan @log.csv", "log.csv", ".toml"),
    "plan without positions": refused("plan multi-position --positions 0", "--positions"),
    "plan of a million positions": refused(
        "plan multi-position --positions 1000000", "--positions", "1000000"
    ),
    "plan of no time": refused("plan multi-position --seconds nan", "--seconds", "nan"),
    "plan of two run files": refused("plan @run.toml --run @imu.toml", "--run"),
    "plan without a table": refused("plan multi-position --out @x.csv", "--out"),
    "plan by an empty path": BadInput("plan @mimu.toml", ("path.csv", "empty"), {"path.csv": b""}),
    "plan by steps of no kind": BadInput(
        "plan @mimu.toml", ("path.csv line 2", "kind"), {"path.csv": swap("position", "posit")}
    ),
    "init from a folder": refused("init -y @", "same"),
    "init from three files": refused("init -y @log.csv @imu.csv @positions.csv", "imu.csv", "same"),
    "init onto the recording": refused(
        "init -y @log.csv --out @log.csv --force", "log.csv", "input"
    ),
    "init, two of one": refused("init -y @log.csv @log.csv --out @new.toml", "log.csv", "twice"),
    "init, a rate of zero": refused((*INIT, "data.rate=0 Hz"), "[data] rate", "positive"),
    "init, a key without a value": refused((*INIT, "data.rate="), "data.rate"),
    "init, a key twice": refused((*INIT, "data.rate=5 Hz", "--set", "data.rate=6 Hz"), "data.rate"),
    "init, the method": refused((*INIT, "method.name=nope"), "'nope'"),
    "init, a section of nobody": refused((*INIT, "foo.bar=1"), "--set foo.bar"),
    "measure a recording": refused("measure @run.toml", "run.toml", "[data] kind"),
    "measure, no readings": refused("measure @plate.toml --readings 0", "--readings"),
    "measure into the log": refused("measure @plate.toml --out @log.csv", "log.csv", "'position'"),
    "measure, an instrument of nowhere": refused("measure @plate.toml -i nope", "'nope'"),
    "measure, a port that is none": refused("measure @plate.toml -i tcp://h:99999", "99999"),
    "bench run, packets of nobody": refused(BENCH.replace("xsens", "nope"), "'nope'", "xsens"),
    "bench run, negative patience": refused(f"{BENCH} --patience -1", "--patience"),
    "bench run, temperatures exchanged": refused(f"{BENCH} --temperature 40:15", "--temperature"),
    "bench run, no speed": refused(f"{BENCH} --speed 0", "--speed"),
    "bench resume, no run": refused("bench resume @", "run.journal"),
    "bench simulate by hand": refused("bench simulate @run.toml", "run.toml", "[bench] kind"),
    "bench simulate, no pace": refused("bench simulate @mimu.toml --pace 0", "--pace"),
    "bench simulate, no rate": refused("bench simulate @mimu.toml --rate 0", "--rate"),
    "bench simulate, negative seed": refused("bench simulate @mimu.toml --seed -1", "--seed"),
    "bench serve, no port": refused("bench serve --port 99999", "--port"),
    "bench devices, a run file alone": refused(
        "bench devices --run @mimu.toml", "--run", "--table"
    ),
}
