/** The set-up of a run: choose, probe and start. */

import { allow, allowed, byId, close, make, open, put } from "./dom.js";
import { makeFilterForm } from "./filter_form.js";
import { fixed, lasting } from "./format.js";
import { notice, order } from "./notice.js";

const TYPED = "typed";
const MOVES = "The servos switch on, the axes home, and the table moves: keep clear of it.";
const ROOM = 3; // times the space that a run needs; less free space is reported as little
const TABLES = /^(pmac|acutrol|motor:tcp):\/\/[^\s/?]+(\?\S*)?$/;
const IMUS = /^tcp:\/\/[^\s/?]+(\?\S*)?$/;

export function makeSetup(people) {
  const [plans, sensors, history] = ["plans", "sensors", "history"].map(byId);
  const sensorName = byId("sensor-name");
  const [table, imu, preset, baud] = ["table", "imu", "preset", "baud"].map(byId);
  const [tableAddress, imuAddress] = ["table-address", "imu-address"].map(byId);
  const motorBaud = byId("motor-baud");
  const [start, probe, answers] = ["start", "probe", "answers"].map(byId);
  const asking = byId("ask-start");
  let wanted = null; // the run in the question, which is the one that starts, whatever was chosen since
  const setup = { whole: null, loaded: [], devices, load };
  const filter = makeFilterForm(showStart);

  byId("again").addEventListener("click", load);
  byId("form").addEventListener("change", (event) => {
    couple(event.target);
    show();
    if (event.target !== byId("name")) answers.replaceChildren(); // the answers were for other devices
  });
  byId("form").addEventListener("input", show);
  // Enter in a field must not move a table.
  byId("form").addEventListener("submit", (event) => event.preventDefault());
  start.addEventListener("click", () => {
    if (!allowed(start)) return notice(start.title);
    people.whenOperating(confirm);
  });
  byId("start-yes").addEventListener("click", () => {
    close(asking);
    if (!wanted) return;
    order({ do: "start", ...wanted }, "Starting …");
    wanted = null;
  });
  probe.addEventListener("click", () => {
    if (!allowed(probe)) return notice(probe.title);
    people.whenOperating(ask);
  });

  const planId = () => plans.querySelector("input:checked")?.value;
  const planNow = () => setup.whole?.plans.find((one) => one.id === planId());

  /** The name that was chosen or typed; null means the plan's own. */
  function named() {
    if (sensors.value === TYPED) return sensorName.value.trim();
    return setup.whole?.sensors.find(({ id }) => String(id) === sensors.value)?.name ?? null;
  }

  async function load() {
    const answer = await fetch("/api/setup").catch(() => null);
    if (answer?.status === 401) return location.reload();
    if (!answer?.ok) return notice("The server did not send its lists of plans and devices.");
    setup.whole = await answer.json();
    fill();
    for (const tell of setup.loaded) tell(setup.whole);
  }

  function fill() {
    const { plans: all, tables, imus, presets, register, trouble } = setup.whole;
    fillPlans(all);
    put(byId("register-trouble"), trouble ? `✗ The register: ${trouble}` : "");
    put(byId("register"), register ? `Register: ${register}` : "");
    const typed = { id: TYPED, what: "network address …" };
    options(table, [...tables, typed].map(({ id, what }) => [id, what]));
    options(imu, [...imus, typed].map(({ id, what }) => [id, what]));
    options(preset, [["", "unknown: probe the devices"],
      ...presets.map((one) => [one.name, `${one.name} (${one.protection})`])]);
    couple(table);
    show();
  }

  /** List the plans; keep the choice, and the focus that new elements would lose. */
  function fillPlans(all) {
    const offered = JSON.stringify(all);
    if (plans.offered === offered) return;
    const [before, focused] = [planId(), plans.contains(document.activeElement)];
    plans.offered = offered;
    plans.replaceChildren(...all.map((one) => planCard(one)));
    // Choose none at first: a plan that nobody has looked at must not move a table.
    const same = plans.querySelector(`input[value="${CSS.escape(before ?? "")}"]:enabled`);
    if (same) same.checked = true;
    if (focused) (same ?? plans.querySelector("input:enabled"))?.focus();
    if (!all.length) plans.append(make("p", {}, "The plan folder contains no plan."));
  }

  /** A simulated bench includes table and IMU; one of them without the other is not possible. */
  function couple(changed) {
    const [mine, other] = changed === table ? [table, imu] : changed === imu ? [imu, table] : [];
    if (!mine || (mine.value === "simulated") === (other.value === "simulated")) return;
    if (mine.value === "simulated") other.value = "simulated";
    else other.selectedIndex = [...other.options].findIndex((one) => one.value !== "simulated");
  }

  /** Update the fields that depend on the choices. */
  function show() {
    const plan = planNow();
    const own = plan ? `${plan.sensor} (name from the plan)` : "name from the plan";
    const known = setup.whole?.sensors ?? [];
    options(sensors, [["", own], ...known.map((one) => [String(one.id), described(one)]),
      [TYPED, "another name …"]]);
    byId("sensor-typed").hidden = sensors.value !== TYPED;
    const name = named() ?? plan?.sensor;
    const entered = known.find((one) => one.name === name);
    history.hidden = !entered;
    if (entered) history.href = `/history/${encodeURIComponent(entered.id)}`;
    byId("table-typed").hidden = table.value !== TYPED;
    byId("imu-typed").hidden = imu.value !== TYPED;
    byId("table-baud").hidden = !isPort(table);
    byId("imu-preset").hidden = byId("imu-baud").hidden = !isPort(imu);
    filter.plan(plan);
    put(byId("summary"), plan ? `${name ? `${name}: ` : ""}${plan.file}, ${plan.steps} steps, about `
      + `${lasting(plan.seconds)}, method ${plan.method}.` : "");
    const [level, words] = room(plan);
    byId("room").className = level;
    put(byId("room"), words);
    byId("moves").textContent = plan?.spins ? "The table turns, and stops whenever the sensor must be remounted: keep clear of it." : MOVES;
    showStart();
  }

  /** Update whether the devices can be probed and a run can be started, and why not. */
  function showStart() {
    const plan = planNow();
    const [level] = room(plan);
    const why = plan ? level === "bad" ? "free some disk space" : unclear() : "choose a plan";
    allow(probe, !why, why);
    const unknown = isPort(imu) && !preset.value;
    const first = why || filter.trouble() || (unknown ? "choose the packet format of the IMU (probing finds it)" : "");
    allow(start, !first, first);
    put(byId("start-why"), first ? `Before you can start: ${first}` : "");
  }

  /** Ask before anything moves, with the names of what will move. */
  function confirm() {
    const plan = planNow();
    if (!plan) return;
    wanted = { plan: planId(), sensor: named(), ambient: ambient(), ...devices() };
    const changes = filter.changes();
    if (changes) wanted.filter = changes;
    const facts = [["plan", `${plan.file}, ${plan.steps} steps, about ${lasting(plan.seconds)}`],
      ["sensor", wanted.sensor ?? plan.sensor], ["table", deviceText(table, tableAddress)],
      ["IMU", deviceText(imu, imuAddress)],
      ...Object.entries(changes ?? {}).map(([key, text]) => [`filter ${key}`, text || "default"])];
    byId("ask-start-moves").textContent = `${byId("moves").textContent} Is everyone clear of it?`;
    const [level, words] = room(plan);
    put(byId("ask-start-room"), level === "care" ? words : "");
    byId("ask-start-facts").replaceChildren(...facts.map(([name, value]) =>
      make("div", {}, make("dt", {}, name), make("dd", {}, value))));
    open(asking);
  }

  /** The room temperature, °C; null if the field is empty, NaN if it is not a number. */
  function ambient() {
    const text = byId("ambient").value.trim().replace(",", ".").replace("\u2212", "-");
    return text === "" ? null : /^-?\d+(\.\d*)?$/.test(text) ? Number(text) : NaN;
  }

  /** A text on whether the disk has room for the run; if it has not, the server refuses it. */
  function room(plan) {
    const { free } = setup.whole ?? {};
    if (!plan?.bytes || !Number.isFinite(free)) return ["", ""];
    const words = `The run needs about ${megabytes(plan.bytes)}, and the disk has ${megabytes(free)} free`;
    return free < plan.bytes ? ["bad", `✗ ${words}. Free some space first.`]
      : free < ROOM * plan.bytes ? ["care", `▲ ${words}, which is not much.`] : ["small", `${words}.`];
  }

  /** What is missing or wrong in the typed values. */
  function unclear() {
    const typed = ambient();
    if (typed !== null && !(typed >= -90 && typed <= 100)) return "enter the ambient temperature as a number in °C";
    if (named() === "") return "type the name of the sensor";
    if (table.value === TYPED && !TABLES.test(tableAddress.value.trim())) {
      return "type the table's address, such as pmac://HOST:1025?motors=1,2,3&counts=3600000";
    }
    if (imu.value === TYPED && !IMUS.test(imuAddress.value.trim())) {
      return "type the IMU's address, such as tcp://HOST:PORT?preset=xsens";
    }
    const bauds = [[table, motorBaud], [imu, baud]].filter(([device]) => isPort(device));
    const wrong = bauds.some(([, field]) => !/^[1-9]\d{2,7}$/.test(field.value.trim()));
    return wrong ? "enter the baud rate as a number such as 115200" : "";
  }

  /** The devices in the form that the server takes. */
  function devices() {
    const of = (device, address, more) => device.value === TYPED ? { address: address.value.trim() }
      : { id: device.value, ...(isPort(device) ? more : {}) };
    return {
      table: of(table, tableAddress, { baud: Number(motorBaud.value) }),
      imu: of(imu, imuAddress, { preset: preset.value || null, baud: Number(baud.value) }),
    };
  }

  async function ask() {
    answers.replaceChildren(make("p", {}, "Probing the devices …"));
    const body = JSON.stringify({ plan: planId(), ...devices() });
    const headers = { "Content-Type": "application/json" };
    const answer = await fetch("/api/probe", { method: "POST", headers, body }).catch(() => null);
    const said = await answer?.json().catch(() => null);
    if (!answer?.ok || !said) {
      const why = said?.words ?? (answer ? `status ${answer.status}` : "no connection");
      const words = `✗ The probe was refused: ${why}`;
      return answers.replaceChildren(make("p", { class: "bad" }, words));
    }
    answers.replaceChildren(...["table", "imu"].filter((key) => said[key]).flatMap((key) => [
      make("p", { class: said[key].ok ? "good" : "bad" },
        `${said[key].ok ? "✓" : "✗"} ${key === "imu" ? "IMU" : "Table"} `
        + (said[key].ok ? "answers" : "does not answer correctly")),
      make("pre", { tabindex: "0" }, said[key].lines.join("\n"))]));
  }

  /** The choices for a manual session; `why` says what is missing. */
  function chosen(withImu) {
    const plan = planNow();
    const unknown = withImu && isPort(imu) && !preset.value;
    const why = plan ? unclear() || (unknown ? "choose the packet format of the IMU (probing finds it)" : "")
      : "choose the plan of this bench";
    return { why, plan, planId: planId(), table: deviceText(table, tableAddress),
      imu: deviceText(imu, imuAddress), devices: devices() };
  }

  return Object.assign(setup, { idle: load, chosen });
}

const megabytes = (bytes) => bytes < 1e9 ? `${fixed(Math.max(bytes / 1e6, 1), 0)} MB` : `${fixed(bytes / 1e9, 1)} GB`;

/** A chosen device as text. */
function deviceText(device, address) {
  return device.value === TYPED ? address.value.trim() : device.selectedOptions[0]?.textContent ?? "";
}

/** Whether a chosen device is a port of the bench's computer. */
function isPort(select) {
  return !["", TYPED, "simulated", "given"].includes(select.value);
}

/** One plan in the list; an unusable one shows what is wrong instead. */
function planCard(plan) {
  const { id, file, sensor, trouble } = plan;
  const disabled = Boolean(trouble);
  const input = make("input", { type: "radio", name: "plan", value: id, disabled });
  const words = trouble
    ? make("span", { class: "bad" }, `✗ cannot be run: ${trouble}`)
    : `${plan.steps} steps · ${lasting(plan.seconds)} · ${plan.method}`;
  return make("label", { class: trouble ? "plan broken" : "plan" }, input,
    make("span", {}, make("strong", {}, file), trouble ? "" : ` ${sensor}`, make("br"),
      make("span", { class: "small" }, words)));
}

/** A sensor in the register, with its calibrations. */
function described({ name, calibrations, last }) {
  const times = `${calibrations} ${calibrations === 1 ? "calibration" : "calibrations"}`;
  return `${name}, ${times}${last ? `, last ${last.slice(0, 10)}` : ""}`;
}

/** List (value, text) pairs, and keep the choice if it is still available. */
function options(select, pairs) {
  const asked = JSON.stringify(pairs);
  if (select.offered === asked) return;
  const before = select.value;
  select.offered = asked;
  select.replaceChildren(...pairs.map(([value, text]) => make("option", { value }, text)));
  if (pairs.some(([value]) => value === before)) select.value = before;
}
