/** The filter parameters of the chosen plan: shows defaults; the server checks changes. */

import { byId, make, put } from "./dom.js";

const INITIAL = "initial."; // prefix of the keys for initial standard deviations

/** `changed` is called when the errors in the form may have changed. */
export function makeFilterForm(changed) {
  const [place, summary, fields] = ["filter", "filter-summary", "filter-fields"].map(byId);
  let shown = ""; // the plan and its parameters that the form shows
  let planId = null;
  let inputs = [];
  let errors = {};
  let asked = 0; // number of the last request; answers to earlier ones are ignored

  fields.addEventListener("change", judge);

  /** Show the parameters of a plan; input for another plan is discarded. */
  function plan(one) {
    const offered = JSON.stringify([one?.id, one?.filter]);
    if (offered === shown) return;
    shown = offered;
    planId = one?.id ?? null;
    errors = {};
    asked += 1;
    const all = one?.filter ?? [];
    place.hidden = !all.length;
    inputs = all.map(field);
    const group = (title, some) => make("fieldset", {}, make("legend", {}, title),
      make("div", { class: "fields" }, ...some.map(({ node }) => node)));
    const initial = inputs.filter(({ key }) => key.startsWith(INITIAL));
    const others = inputs.filter(({ key }) => !key.startsWith(INITIAL));
    fields.replaceChildren(group("Observations, epoch and states", others),
      group("Standard deviations before the data (P₀)", initial));
    show();
  }

  function field({ key, meaning, default: own, stated, least, largest, choices }) {
    const name = key.replace(INITIAL, "").replaceAll("_", " ");
    const id = `filter-${key.replace(".", "-")}`;
    const label = make("label", { for: id }, make("strong", {}, name));
    const described = { id, name: key, "aria-describedby": `${id}-what ${id}-error` };
    const input = choices.length
      ? make("select", described, make("option", { value: "" }, `default: ${own}`),
        ...choices.map((value) => make("option", { value }, value)))
      : make("input", { ...described, type: "text", autocomplete: "off", spellcheck: "false",
        maxlength: "40", placeholder: own });
    input.value = stated;
    const range = least ? `, ${least} to ${largest}` : "";
    const what = make("p", { class: "small", id: `${id}-what` },
      `${meaning}; default ${own}${range}`);
    const wrong = make("p", { class: "bad", id: `${id}-error`, role: "alert" });
    const node = make("div", { class: "parameter" }, label, input, what, wrong);
    return { key, stated, input, wrong, node };
  }

  /** The parameters that differ from the run file's; null if there are none. */
  function changes() {
    const found = inputs.filter(({ input, stated }) => input.value.trim() !== stated);
    return found.length ? Object.fromEntries(found.map(({ key, input }) => [key, input.value.trim()])) : null;
  }

  async function judge() {
    const filter = changes();
    const question = (asked += 1);
    show();
    if (!filter) {
      errors = {};
      return show();
    }
    const headers = { "Content-Type": "application/json" };
    const body = JSON.stringify({ plan: planId, filter });
    const answer = await fetch("/api/filter", { method: "POST", headers, body }).catch(() => null);
    const said = await answer?.json().catch(() => null);
    if (question !== asked) return;
    errors = said?.errors ?? { "": said?.words ?? "the server did not check the parameters" };
    show();
  }

  function show() {
    const count = Object.keys(changes() ?? {}).length;
    put(summary, `Filter parameters${count ? `: ${count} changed` : ""}`);
    for (const { key, input, wrong } of inputs) {
      put(wrong, errors[key] ? `✗ ${errors[key]}` : "");
      input.setAttribute("aria-invalid", String(Boolean(errors[key])));
    }
    put(byId("filter-error"), errors[""] ? `✗ ${errors[""]}` : "");
    changed();
  }

  /** Why a run cannot start with these parameters; empty if it can. */
  function trouble() {
    const [key] = Object.keys(errors);
    return key === undefined ? "" : `correct ${key ? `the filter parameter ${key.replace(INITIAL, "").replaceAll("_", " ")}` : "the filter parameters"}`;
  }

  return { plan, changes, trouble };
}
