// What belongs to the browser, not to the machine: light or dark, messages of the system, names for screen readers.
(() => {
  // Parts of Quasar that a screen reader finds without a name, or with children that their role does not allow
  const REPAIRS = {
    // the input is inside a button without a name: the input alone is the control
    ".q-uploader a[role=button]": (button) => {
      const input = button.querySelector("input");
      if (!input) return;
      button.removeAttribute("role");
      button.tabIndex = -1;
      input.tabIndex = 0;
      input.setAttribute("aria-label", window.mcTexts["Choose a file"]);
    },
    ".q-loading-bar:not([aria-label])": (bar) => bar.setAttribute("aria-label", window.mcTexts["loading"]),
    ".q-menu[role=listbox] > .q-virtual-scroll__content:not([role])": (list) => list.setAttribute("role", "group"),
    ".q-menu[role=listbox] > .q-virtual-scroll__padding:not([role])": (space) => space.setAttribute("role", "presentation"),
  };
  const repair = () => {
    for (const [selector, change] of Object.entries(REPAIRS)) document.querySelectorAll(selector).forEach(change);
  };
  new MutationObserver(repair).observe(document.body, { childList: true, subtree: true });

  // light or dark: as the system says, until somebody chooses
  const THEME = "mc-theme";
  const CHOICES = { light: false, dark: true };
  const wear = (name) => setDark(CHOICES[name] ?? null);
  window.mcTheme = (name) => {
    localStorage.setItem(THEME, name);
    wear(name);
  };
  window.addEventListener("load", () => {
    const name = localStorage.getItem(THEME);
    // NiceGUI sets its own choice as it starts
    if (name in CHOICES) setTimeout(() => wear(name), 0);
  });

  // the language is asked of the server, with every page
  window.mcLanguage = (code) => {
    document.cookie = `mc-language=${code}; path=/; max-age=31536000; samesite=lax${location.protocol === "https:" ? "; secure" : ""}`;
    location.reload();
  };

  // messages of the system, for who looks at something else: asked for by a click, as browsers want it
  const WANTED = "mc-messages";
  window.mcAskMessages = async () => {
    const answer = "Notification" in window ? await Notification.requestPermission() : "unsupported";
    localStorage.setItem(WANTED, answer === "granted" ? "on" : "off");
    return answer;
  };
  window.mcTell = (title, text) => {
    if (localStorage.getItem(WANTED) !== "on" || document.hasFocus()) return;
    if (!("Notification" in window) || Notification.permission !== "granted") return;
    // phones allow them from a service worker alone
    try { new Notification(title, { body: text, tag: title }); } catch { localStorage.setItem(WANTED, "off"); }
  };

  window.mcLeave = async () => {
    await fetch("/logout", { method: "POST", redirect: "manual" });
    location.assign("/login");
  };
})();
