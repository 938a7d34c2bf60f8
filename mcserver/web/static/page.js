// Hold-to-jog: the browser's part. It sends while a button is down and says so when it is not; it never lets a
// message go out for a press that has ended, whatever ended it.
(() => {
  const KEEP_MS = 100;
  let held = null;

  const send = (kind) => emitEvent("mc_jog", {
    kind, press: held.press, axis: held.axis, direction: held.direction, sent_s: performance.now() / 1000,
  });

  const press = (button) => {
    if (held || button.disabled || button.getAttribute("aria-disabled") === "true") return;
    held = {
      press: Date.now(), axis: Number(button.dataset.axis), direction: Number(button.dataset.direction), button,
    };
    button.classList.add("held");
    send("press");
    held.timer = setInterval(() => (document.hasFocus() && !document.hidden ? send("keep") : release()), KEEP_MS);
  };

  const release = () => {
    if (!held) return;
    clearInterval(held.timer);
    held.button.classList.remove("held");
    send("release");
    held = null;
  };

  const target = (event) => event.target instanceof Element && event.target.closest("[data-jog]");
  const isKey = (event) => event.key === " " || event.key === "Enter";

  document.addEventListener("pointerdown", (event) => {
    const button = target(event);
    if (button && event.button === 0) { event.preventDefault(); button.focus(); press(button); }
  }, true);
  for (const name of ["pointerup", "pointercancel"]) document.addEventListener(name, release, true);
  document.addEventListener("pointermove", (event) => {
    if (!held || event.pointerType === "touch") return;
    const box = held.button.getBoundingClientRect();
    if (event.clientX < box.left || event.clientX > box.right || event.clientY < box.top || event.clientY > box.bottom) release();
  });
  document.addEventListener("contextmenu", (event) => { if (target(event)) event.preventDefault(); });
  document.addEventListener("keydown", (event) => {
    const button = target(event);
    if (button && isKey(event)) { event.preventDefault(); event.stopPropagation(); if (!event.repeat) press(button); }
  }, true);
  document.addEventListener("keyup", (event) => { if (isKey(event)) release(); }, true);
  document.addEventListener("focusout", (event) => { if (held && event.target === held.button) release(); });
  document.addEventListener("visibilitychange", () => { if (document.hidden) release(); });
  window.addEventListener("blur", release);
  window.addEventListener("pagehide", release);
  window.addEventListener("offline", release);

  // Quasar's uploader has its input inside a button without a name: the input alone is the control
  setInterval(() => document.querySelectorAll(".q-uploader a[role=button]").forEach((button) => {
    const input = button.querySelector("input");
    if (!input) return;
    button.removeAttribute("role");
    button.tabIndex = -1;
    input.tabIndex = 0;
    input.setAttribute("aria-label", "Choose a file");
  }), 500);

  // so that the page can tell a delayed message from a prompt one before the first press
  setInterval(() => { if (!held) emitEvent("mc_clock", { sent_s: performance.now() / 1000 }); }, 2000);

  // what a page shows when nothing comes any more is old, and looks like the truth: say so
  const SILENT_MS = 3000;
  let alive = null;
  window.mcAlive = () => { alive = performance.now(); document.body.classList.remove("mc-silent"); };
  setInterval(() => {
    if (alive !== null && performance.now() - alive > SILENT_MS) document.body.classList.add("mc-silent");
  }, 500);

  // keys that work anywhere but in a field: Shift+Escape is the emergency stop, Space a feed hold
  document.addEventListener("keydown", (event) => {
    const typing = event.target instanceof Element && event.target.closest("input, textarea, [contenteditable], button, a, [role=tab]");
    if (event.key === "Escape" && event.shiftKey) emitEvent("mc_key", { key: "estop" });
    else if (event.key === " " && !typing) { event.preventDefault(); emitEvent("mc_key", { key: "hold" }); }
  });

  // the newest samples of the signals shown, kept here so that each is sent once
  const charts = {};
  window.mcChart = (id, { names, units, span, rows, restart }) => {
    const kept = restart ? (charts[id] = { rows: [] }) : (charts[id] ??= { rows: [] });
    kept.rows.push(...rows);
    const end = kept.rows.length ? kept.rows[kept.rows.length - 1][0] : 0;
    const first = kept.rows.findIndex((row) => row[0] >= end - span);
    if (first > 0) kept.rows.splice(0, first);
    const chart = getElement(id)?.chart;
    if (!chart) return;
    const grids = [...new Set(units)];
    const height = 100 / Math.max(grids.length, 1);
    const dark = document.body.classList.contains("body--dark");
    const text = { color: dark ? "#cbd5e1" : "#334155" };
    chart.setOption({
      animation: false,
      tooltip: { trigger: "axis" },
      axisPointer: { link: [{ xAxisIndex: "all" }] },
      legend: { top: 0, right: 8, left: 80, type: "scroll", textStyle: text },
      grid: grids.map((_, row) => ({ left: 56, right: 12, top: `${row * height + 12}%`, height: `${height - 16}%` })),
      xAxis: grids.map((_, row) => ({ type: "value", gridIndex: row, min: -span, max: 0, splitNumber: chart.getWidth() < 420 ? 3 : 6, axisLabel: { ...text, show: row === grids.length - 1, formatter: "{value} s", hideOverlap: true } })),
      yAxis: grids.map((unit, row) => ({ type: "value", gridIndex: row, scale: true, axisLine: { onZero: false }, name: unit, nameTextStyle: { ...text, align: "right" }, axisLabel: text })),
      series: names.map((name, column) => ({
        type: "line", name, showSymbol: false, step: units[column] === "on/off" ? "end" : false,
        xAxisIndex: grids.indexOf(units[column]), yAxisIndex: grids.indexOf(units[column]),
        data: kept.rows.map((row) => [row[0] - end, row[column + 1]]),
      })),
    }, { replaceMerge: ["series", "grid", "xAxis", "yAxis"] });
  };
})();
