"""The plots of a run: one time base, marks, cursor, zoom; and what is in sight."""

import re

import pytest
from playwright.sync_api import Page, expect
from tests.browser import messages
from tests.browser.page_actions import open_page, open_running_page
from tests.browser.scripted_server import ScriptedServer

PLOTS = ('[data-measures="f"] .plot', '[data-measures="w"] .plot', "#course-plot")
FULL_HD_LAPTOP = {"width": 1366, "height": 768}


def pointed(page: Page, plot: str, share: float) -> None:
    """Move the mouse to a share of the width of a plot's lines."""
    over = page.locator(f"{plot} .u-over")
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    assert box
    page.mouse.move(box["x"] + share * box["width"], box["y"] + box["height"] / 2)


def seconds(text: str) -> float:
    """Return the time of the run that a text begins with: "at 1:35.2", "1:35"."""
    found = re.search(r"(\d+):(\d+(?:\.\d+)?)", text)
    assert found, text
    return 60 * float(found[1]) + float(found[2])


def legend(page: Page, plot: str) -> str:
    """Return what is read at the cursor of a plot."""
    place = "#course-legend" if plot == "#course-plot" else plot.replace(".plot", ".legend")
    return page.locator(f"{place} .at").inner_text()


@pytest.mark.slow
def test_an_event_is_marked_in_every_plot_at_the_time_that_its_list_says(
    page: Page, scripted: ScriptedServer
):
    open_running_page(page, scripted)
    scripted.tell(messages.event(95.0, "axis inner: following error", "warning"))
    for plot in PLOTS:
        page.locator(plot).scroll_into_view_if_needed()
        expect(page.locator(plot)).to_have_attribute("data-marks", re.compile(r"\b95\b"))
    expect(page.locator("#event-list li").first).to_contain_text("1:35")
    for plot in PLOTS[:2]:
        pointed(page, plot, 0.5)  # of the last 10 s before 1:40
        expect(page.locator(plot.replace(".plot", ".legend"))).to_contain_text("following error")
        assert seconds(legend(page, plot)) == pytest.approx(95, abs=1)


@pytest.mark.slow
def test_header_events_and_plots_count_from_the_start_of_the_run(
    page: Page, scripted: ScriptedServer
):
    open_running_page(page, scripted)
    shown = seconds(page.locator("#clock").inner_text())
    for plot in PLOTS:
        pointed(page, plot, 0.99)
        assert seconds(legend(page, plot)) == pytest.approx(shown, abs=1.1)


def test_a_time_has_as_many_places_as_the_plot_needs(page: Page, scripted: ScriptedServer):
    open_page(page, scripted)
    call = "async ([s, span]) => (await import('/static/format.js')).instant(s, span)"
    for seconds, span, text in (
        (91.99999999999, 2, "1:32.0"),
        (92.00000000001, 2, "1:32.0"),
        (59.96, 2, "1:00.0"),
        (3600.07, 0.5, "1:00:00.07"),
        (95.4, 10, "1:35"),
        (-1e-9, 0.05, "0:00.000"),
    ):
        assert page.evaluate(call, [seconds, span]) == text


@pytest.mark.slow
def test_last_10_s_are_10_s(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    expect(page.locator("#window")).to_have_text("last 10 s")
    ends: list[float] = []
    for share in (0.001, 0.999):
        pointed(page, PLOTS[0], share)
        ends.append(seconds(legend(page, PLOTS[0])))
    assert ends[1] - ends[0] == pytest.approx(10, abs=1)  # read to whole seconds


@pytest.mark.slow
def test_the_cursor_tells_the_values_at_its_time_in_every_plot(
    page: Page, scripted: ScriptedServer
):
    open_running_page(page, scripted)
    for plot in PLOTS[:2]:
        place = plot.replace(".plot", ".legend")
        page.mouse.move(0, 0)  # the cursors of all plots move together
        expect(page.locator(f"{place} .at")).to_be_empty()
        before = page.locator(f"{place} .value").all_inner_texts()
        pointed(page, plot, 0.4)
        expect(page.locator(f"{place} .at")).to_contain_text("at 1:3")
        at = page.locator(f"{place} .value").all_inner_texts()
        assert at != before
    told = float(page.locator('[data-measures="f"] .value').first.inner_text().replace("−", "-"))
    now = seconds(legend(page, PLOTS[1]))
    ring = messages.samples(now - 1, now + 1)["y"][0]
    assert min(ring) - 1e-3 <= told <= max(ring) + 1e-3
    pointed(page, PLOTS[2], 0.5)
    expect(page.locator("#course-legend")).to_contain_text("µg")
    assert 20 < seconds(legend(page, PLOTS[2])) < 100


@pytest.mark.slow
def test_a_plot_is_zoomed_by_dragging_and_shows_all_again(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    pointed(page, PLOTS[0], 0.2)
    page.mouse.down()
    pointed(page, PLOTS[0], 0.4)
    page.mouse.up()
    expect(page.locator("#window")).to_have_text(re.compile(r"^1:3\d(\.\d)? to 1:3\d(\.\d)?$"))
    first, last = page.locator("#window").inner_text().split(" to ")
    assert seconds(last) - seconds(first) == pytest.approx(2, abs=0.3)
    scripted.tell(messages.samples(100, 101))
    expect(page.locator("#window")).to_have_text(f"{first} to {last}")  # it stays where it is
    page.get_by_role("button", name="Last 10 s").click()
    expect(page.locator("#window")).to_have_text("last 10 s")


@pytest.mark.slow
def test_plots_are_read_and_zoomed_by_keys(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    for plot in PLOTS:
        page.locator(plot).focus()
        page.keyboard.press("ArrowLeft")
        newest = seconds(legend(page, plot))
        for _ in range(4):
            page.keyboard.press("Shift+ArrowLeft")
        assert seconds(legend(page, plot)) <= newest
        page.keyboard.press("+")
        page.keyboard.press("0")
    assert not scripted.heard


@pytest.mark.slow
def test_the_time_of_an_event_shows_it_in_the_plots(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    scripted.tell(messages.event(96.0, "the watchdog is heard again", "warning"))
    page.get_by_role("button", name="1:36: show it in the plots").click()
    expect(page.locator('[data-measures="f"] .legend')).to_contain_text("the watchdog is heard")
    scripted.tell(messages.event(40.0, "long ago"))
    page.get_by_role("button", name="0:40: show it in the plots").click()
    expect(page.locator("#notice")).not_to_be_empty()


@pytest.mark.slow
def test_readings_are_plotted_before_the_axes_have_their_zeros(
    page: Page, scripted: ScriptedServer
):
    homing = messages.state(3.0, phase="home", attitude=None)
    open_page(page, scripted, messages.plan(), homing, messages.samples(0.5, 3.0))
    expect(page.locator("#phase")).to_contain_text("homing")
    value = page.locator('[data-measures="f"] .value').first
    expect(value).to_have_text(re.compile(r"\d\.\d"))
    expect(page.locator(f"{PLOTS[0]} canvas")).to_be_visible()
    ends: list[float] = []
    for share in (0.06, 0.28):  # the scale begins at 0 and is 10 s long
        pointed(page, PLOTS[0], share)
        ends.append(seconds(legend(page, PLOTS[0])))
    assert ends == pytest.approx([0.6, 2.8], abs=0.6)


@pytest.mark.slow
def test_axes_and_last_events_are_in_sight_of_a_small_laptop(page: Page, scripted: ScriptedServer):
    page.set_viewport_size(FULL_HD_LAPTOP)  # type: ignore[arg-type]
    open_running_page(page, scripted)
    scripted.tell(*(messages.event(90.0 + k, f"step {k}") for k in range(9)))
    for name in ("outer", "middle", "inner"):
        row = page.locator("#axes").get_by_role("row", name=re.compile(name))
        expect(row).to_be_in_viewport(ratio=1)
    for k in (8, 7, 6):
        line = page.locator("#event-list li").filter(has_text=f"step {k}")
        expect(line).to_be_in_viewport(ratio=1)
    for plot in PLOTS[:2]:
        expect(page.locator(plot)).to_be_in_viewport(ratio=1)


@pytest.mark.slow
def test_no_label_of_a_scale_is_cut(own_page: Page, scripted: ScriptedServer):
    """The text of uPlot's scales is watched as it is drawn, with its place in the canvas."""
    page = own_page
    page.add_init_script(
        """window.cut = []; const fill = CanvasRenderingContext2D.prototype.fillText;
        CanvasRenderingContext2D.prototype.fillText = function (text, x, y, ...more) {
            const { a, e, d, f } = this.getTransform(), wide = a * this.measureText(text).width;
            const [at, down] = [a * x + e, d * y + f];
            const left = { center: at - wide / 2, right: at - wide }[this.textAlign] ?? at;
            if (this.canvas.closest(".plot") && (left < 0 || left + wide > this.canvas.width
                || down < 0 || down > this.canvas.height)) window.cut.push([text, left, wide]);
            return fill.call(this, text, x, y, ...more); };"""
    )
    for width in (1366, 400):
        page.set_viewport_size({"width": width, "height": 900})
        open_running_page(page, scripted)
        tiny = messages.samples(100, 101)
        tiny["y"] = [[-1234.5 + 1e-4 * k for k, _ in enumerate(row)] for row in tiny["y"]]
        scripted.tell(tiny, messages.state(3701.0))
        for plot in PLOTS:
            page.locator(plot).scroll_into_view_if_needed()
            expect(page.locator(f"{plot} canvas")).to_be_visible()
        for _ in range(6):
            page.locator("#readings-zoom").get_by_role("button", name="Zoom in").click()
        page.wait_for_function("before => window.inercal.frames > before", arg=0)
        assert page.evaluate("window.cut") == [], width


def test_near_pitch_90_the_difference_is_shown_and_no_roll_and_heading(
    page: Page, scripted: ScriptedServer
):
    state = messages.state(100.0)
    upright = [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]  # y points up
    state["attitude"] |= {"table": upright, "navigation": upright, "pitch": 89.9, "roll": 12.0}
    open_page(page, scripted, messages.plan(), messages.estimates(100.0), state)
    rows = page.locator("#attitude-numbers")
    expect(page.locator("#attitude-pole")).not_to_be_empty()
    expect(rows.get_by_role("row", name="roll")).to_have_text("roll——")
    expect(rows.get_by_role("row", name="heading")).to_have_text("heading——")
    expect(rows.get_by_role("row", name="pitch")).to_contain_text("89.900")
    expect(rows.get_by_role("row", name="difference, ″")).to_contain_text("3.3")  # |1.2, −0.4, 3.1|
    scripted.tell(messages.state(100.1))
    expect(page.locator("#attitude-pole")).to_be_empty()
    expect(rows.get_by_role("row", name="roll")).to_contain_text("1.234")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("level", "words", "sign"),
    [
        ("good", "consistent", "✓"),
        ("care", "usable with reservations", "▲"),
        ("bad", "not to be relied on", "✗"),
    ],
)
def test_nis_and_verdict_have_a_colour_a_sign_and_a_word(
    page: Page, scripted: ScriptedServer, level: str, words: str, sign: str
):
    judged = {"w": {"ratio": 1.31, "level": level, "words": words}}
    open_running_page(page, scripted)
    scripted.tell(messages.estimates(101.0) | {"nis": judged})
    grade = page.locator("#nis .grade").filter(has_text="gyros")
    expect(grade).to_have_text(f"{sign} gyros 1.31: {words}")
    colour = page.evaluate(
        """(name) => { const probe = document.createElement("p"); document.body.append(probe);
        probe.style.color = `var(--${name})`; return getComputedStyle(probe).color; }""",
        level,
    )
    expect(grade).to_have_css("color", colour)
    explained = page.locator("#nis details p")
    expect(explained).to_be_hidden()
    page.locator("#nis summary").click()
    expect(explained).to_be_visible()

    numbers = "24 coefficients estimated; the data agree (χ² = 17.0, p = 0.4)"
    verdict = {"level": level, "words": words, "reasons": ["few rests"]}
    scripted.tell(messages.done(words=numbers, verdict=verdict))
    told = page.locator("#verdict-words")
    expect(told).to_have_text(f"{sign} {words}")
    expect(told).to_have_css("color", colour)
    expect(page.locator("#done-words")).to_be_hidden()
    page.locator("#verdict-details summary").click()
    expect(page.locator("#done-words")).to_have_text(numbers)


@pytest.mark.slow
def test_the_finished_page_shows_the_uncertainties_of_the_calibration_file(
    page: Page, scripted: ScriptedServer
):
    open_running_page(page, scripted)
    names = [one["name"] for one in messages.plan()["coefficients"]]
    final = {
        "names": names[::-1],
        "values": [float(i) for i in range(24)],
        "u2": [0.5 + i for i in range(24)],
    }
    scripted.tell(messages.done(final=final))
    expect(page.locator("#estimates-title")).to_contain_text("U, k = 2")
    expect(page.locator('[data-name="ax.k0"] .value')).to_have_text("23 ± 24")
    expect(page.locator('[data-name="gz.delta_p"] .value')).to_have_text("0.00 ± 0.50")
    scripted.tell(messages.estimates(200.0))  # what comes late changes no result
    page.wait_for_function("seen => window.inercal.messages > seen", arg=5)
    expect(page.locator('[data-name="ax.k0"] .value')).to_have_text("23 ± 24")
    scripted.tell(messages.plan())
    expect(page.locator("#estimates-title")).to_contain_text("± 2σ")


@pytest.mark.slow
def test_symbols_carry_their_names_in_sight_and_as_a_tooltip(page: Page, scripted: ScriptedServer):
    open_running_page(page, scripted)
    heads = page.locator("#coefficients tbody th")
    for k, name in enumerate(("bias", "scale-factor error", "misalignment about O")):
        expect(heads.nth(k)).to_contain_text(name)
    expect(heads.nth(0).get_by_role("link")).to_have_attribute("title", "K₀: bias")
    expect(heads.nth(2).get_by_role("link")).to_have_attribute("title", "δ_O: misalignment about O")
    expect(page.locator('[data-name="ax.k1"]')).to_have_attribute(
        "title", "ax.k1: scale-factor error"
    )
    for part in ("ax.k0", "bias", "µg"):
        expect(page.locator("#course-title")).to_contain_text(part)
