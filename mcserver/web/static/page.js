// Hold-to-jog: the browser's part. It sends while a button is down and says so when it is not; it never lets a
// message go out for a press that has ended, whatever ended it.
(() => {
  const KEEP_MS = 100;
  let held = null;

  const send = (kind) => emitEvent("mc_jog", {
    kind, press: held.press, pad: held.pad, what: held.what, direction: held.direction,
  });

  const press = (button) => {
    if (held || button.disabled || button.getAttribute("aria-disabled") === "true") return;
    const { jog: pad, what, direction } = button.dataset;
    // later than the one before, however the clock is set meanwhile
    held = { press: Math.round(performance.timeOrigin + performance.now()), pad, what, direction: Number(direction), button };
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
    if (!held) return;
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

  // The second press of a double click would run a program twice, or ask twice. Of fingers browsers do not count them.
  const TWICE_MS = 500;
  const OFTEN = "[data-estop], [data-often]";
  let before = { button: null, at: 0 };
  document.addEventListener("click", (event) => {
    const button = event.target.closest?.("button") ?? null, at = event.timeStamp;
    const twice = event.detail > 1 || (event.pointerType === "touch" && at - before.at < TWICE_MS);
    const again = twice && button && button === before.button && !button.matches(OFTEN);
    before = { button, at };
    if (!again) return;
    event.preventDefault();
    event.stopImmediatePropagation();
  }, true);

  // A click is for what was pressed: where something has come above it meanwhile, another button is below the
  // finger when it is let go, or none.
  const SAME_PLACE = 10;
  const TARGETS = "button, a, .ag-checkbox-input";
  let pressed = null;
  document.addEventListener("pointerdown", (event) => {
    pressed = { button: event.target.closest?.(TARGETS) ?? null, x: event.clientX, y: event.clientY };
  }, true);
  document.addEventListener("click", (event) => {
    const button = event.target.closest?.(TARGETS) ?? null;
    // by the keyboard, or by a script
    if (!event.isTrusted || event.detail === 0 || !pressed || pressed.button === button) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    const still = Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) < SAME_PLACE;
    if (still && pressed.button?.isConnected) pressed.button.click();
  }, true);

  // what lies below the bar with the emergency stop can be reached, however high that is
  const bar = new ResizeObserver(([{ target }]) => {
    document.documentElement.style.setProperty("--mc-header", `${target.offsetHeight}px`);
  });

  // what a page shows when nothing comes any more is old, and looks like the truth: say so
  const SILENT_MS = 3000;
  let alive = null, sign = 0, tellTime = null;
  window.mcAlive = (number) => {
    sign = number;
    alive = performance.now();
    tellTime();
    document.body.classList.remove("mc-silent");
  };
  setInterval(() => {
    if (alive !== null && performance.now() - alive > SILENT_MS) document.body.classList.add("mc-silent");
  }, 500);

  // A page without a link takes nothing that it could not send. Until it has its first one nothing in it can be reached
  // but the emergency stop. Where it has lost it, nothing that acts but what stops: a text goes on being written, which
  // is sent when the link is back.
  const ALL = "main, .q-header :is(a, button:not([data-estop]))";
  const ACTING = "button:not([data-estop], [data-stop]), .q-select, .q-toggle, .q-checkbox, .q-slider, .q-uploader";
  const unreached = new Set();
  let hasBeenLinked = false, focused = null;
  const says = document.createElement("div");
  says.className = "mc-link";
  says.setAttribute("aria-live", "polite");
  document.body.prepend(says);
  const putOutOfReach = () => {
    for (const each of document.querySelectorAll(hasBeenLinked ? ACTING : ALL)) {
      if (!each.inert) { each.inert = true; unreached.add(each); }
    }
  };
  const whileUnlinked = new MutationObserver(putOutOfReach);
  const unlink = () => {
    focused = document.activeElement;
    document.body.classList.add("mc-unlinked");
    says.textContent = hasBeenLinked
      ? window.mcTexts["No connection: what you write stays and is sent later; only stops can be pressed"]
      : window.mcTexts["Connecting …"];
    whileUnlinked.observe(document.body, { childList: true, subtree: true });
    putOutOfReach();
  };
  // the page's process has taken this browser on, or again
  window.mcLinked = () => {
    if (!hasBeenLinked) {
      hasBeenLinked = true;
      sendSurely();
      bringBack();
      const header = document.querySelector(".q-header");
      if (header) bar.observe(header);
    }
    whileUnlinked.disconnect();
    for (const each of unreached) each.inert = false;
    unreached.clear();
    document.body.classList.remove("mc-unlinked");
    says.textContent = "";
    if (document.activeElement === document.body) focused?.focus();
  };
  unlink();

  // What is done at the page while its link is cut, or has been sent when it is, goes out again when the link is back:
  // in its order, until it is confirmed. The page's process takes it once (resuming.py), and refuses what is too late.
  const UNCERTAIN = "mc-uncertain";
  // what somebody does at this moment, in the words of the page: with what, and a line or a text
  let doing = null;
  const begin = (element, text = "") => { doing = { name: nameOf(element), text }; setTimeout(() => { doing = null; }, 100); };
  const nameOf = (element) => element.getAttribute("aria-label") || element.innerText;
  document.addEventListener("click", ({ target }) => { if (target.closest?.("button")) begin(target.closest("button")); }, true);
  document.addEventListener("keydown", (event) => {
    const { key, target } = event;
    if (key !== "Enter" || !target.matches?.("input")) return;
    if (document.body.classList.contains("mc-unlinked")) { event.preventDefault(); event.stopImmediatePropagation(); }
    else begin(target, target.value);
  }, true);
  // the tab keeps the others, and the address
  document.addEventListener("input", ({ target }) => { if (!target.matches("[data-kept], [data-address]")) begin(target, target.value); }, true);
  const sendSurely = () => {
    const { socket } = window, emit = socket.emit.bind(socket), unconfirmed = new Map();
    const now_s = () => performance.now() / 1000;
    let number = 0;
    const send = ({ event }) => emit("event", { ...event }, () => unconfirmed.delete(event.number));
    socket.emit = (kind, content, ...rest) => {
      if (kind !== "event") return emit(kind, content, ...rest);
      number += 1;
      const each = { event: { ...content, number, document: window.documentId, sent_s: now_s() }, doing };
      unconfirmed.set(number, each);
      if (socket.connected) send(each);
      return socket;
    };
    // a page that is loaded anew says what it cannot know: its process is another one, or has given it up
    const lost = sessionStorage.getItem(UNCERTAIN);
    sessionStorage.removeItem(UNCERTAIN);
    if (lost) {
      const message = window.mcTexts["It is not certain that this arrived: {what}"].replace("{what}", () => lost);
      const closeBtn = window.mcTexts["close"];
      Quasar.Notify.create({ message, closeBtn, type: "warning", position: "bottom", timeout: 0 });
    }
    window.addEventListener("pagehide", () => {
      // of a text what it was at the end
      const names = new Map([...unconfirmed.values()].filter(({ doing }) => doing).map(({ doing }) => [doing.name, doing.text]));
      if (names.size) sessionStorage.setItem(UNCERTAIN, [...names].map((each) => each.join(" ").trim()).join(", "));
    });
    // so that the page's process can tell what was held up on the way, and how far this browser has come in what it was
    // sent (page_timer.py)
    tellTime = () => { if (socket.connected) emit("clock", { client_id: window.clientId, sent_s: now_s(), sign }); };
    socket.on("connect", () => { tellTime(); unconfirmed.forEach(send); });
    socket.on("disconnect", unlink);
  };

  // What is looked for in the fleet's table is found here, whatever becomes of the link. It stays in the address, from
  // which a page that is loaded anew is made. A column's word is what is shown; filters of other columns stay.
  window.mcLookFor = (name, value, word = value) => {
    const address = new URL(location.href);
    if (value) address.searchParams.set(name, value);
    else address.searchParams.delete(name);
    history.replaceState(history.state, "", address);
    const { api } = getElement(document.querySelector(".mc-fleet"));
    if (name === "search") return api.setGridOption("quickFilterText", value ?? "");
    const filters = api.getFilterModel();
    if (value) filters[name] = { filterType: "text", type: "equals", filter: word };
    else delete filters[name];
    return api.setFilterModel(filters);
  };

  // A text that is an hour's work outlasts a page that is loaded anew, which a cut link is enough for: the tab keeps
  // it, whatever has become of the page's process.
  const keptAs = (field) => `${location.pathname} ${field.dataset.kept}`;
  window.addEventListener("pagehide", () => {
    // one that never had a link has not brought it back yet
    if (!hasBeenLinked) return;
    for (const field of document.querySelectorAll("[data-kept]")) sessionStorage.setItem(keptAs(field), field.value);
  });
  const bringBack = () => {
    for (const field of document.querySelectorAll("[data-kept]")) {
      if (field.value) continue;
      field.value = sessionStorage.getItem(keptAs(field)) ?? "";
      field.dispatchEvent(new Event("input", { bubbles: true }));
    }
  };

  // who only looks: buttons that would be refused are disabled, whatever is drawn anew; data-look has the others
  window.mcWatchOnly = () => {
    const grid = document.querySelector(".mc-grid");
    if (!grid || grid.dataset.watched) return;
    grid.dataset.watched = "1";
    const disable = () => {
      for (const button of grid.querySelectorAll("button:not([disabled])")) {
        if ("look" in button.dataset || button.closest(".q-expansion-item__container > .q-item")) continue;
        button.disabled = true;
        button.classList.add("disabled");
      }
    };
    disable();
    new MutationObserver(disable).observe(grid, { childList: true, subtree: true, attributeFilter: ["disabled"] });
  };

  // keys that work anywhere but in a field: Shift+Escape is the emergency stop, Space a feed hold
  const KEYED = "input, textarea, [contenteditable], button, a, [role=tab], [role=button], [role=menuitem]";
  document.addEventListener("keydown", (event) => {
    const typing = event.target instanceof Element && event.target.closest(KEYED);
    if (event.key === "Escape" && event.shiftKey) emitEvent("mc_key", { key: "estop" });
    else if (event.key === " " && !typing) { event.preventDefault(); emitEvent("mc_key", { key: "hold" }); }
  });
})();
