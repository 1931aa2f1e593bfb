
"use strict";
(() => {
  const root = document.documentElement;
  addEventListener("error", () => { root.dataset.errors = 1 + Number(root.dataset.errors || 0); });
  const make = (tag, properties, ...children) => {
    const element = Object.assign(document.createElement(tag), properties);
    element.append(...children);
    return element;
  };

  // Tables: a button in each heading sorts up, then down, then as at first.
  const compare = (a, b) => {
    if (a === b) return 0;
    if (a === "" || b === "") return a === "" ? 1 : -1;
    const [x, y] = [Number(a), Number(b)];
    return Number.isNaN(x) || Number.isNaN(y) ? a.localeCompare(b, "en", { numeric: true }) : x - y;
  };
  const prepareTable = (table) => {
    const body = table.tBodies[0];
    const rows = [...body.rows];
    const headings = [...table.tHead.rows[0].cells];
    if (rows.length < 2) return;
    headings.forEach((heading, column) => {
      const button = make("button", { type: "button", title: "Sort by this column" }, ...heading.childNodes);
      heading.append(button);
      button.addEventListener("click", () => {
        const next = { ascending: "descending", descending: "none" }[heading.ariaSort] || "ascending";
        headings.forEach((other) => { other.ariaSort = "none"; });
        heading.ariaSort = next;
        const value = (row) => row.cells[column].dataset.v;
        const sign = next === "descending" ? -1 : 1;
        // What has no value stays last.
        const order = (a, b) => (value(a) === "" || value(b) === "" ? 1 : sign) * compare(value(a), value(b));
        body.append(...(next === "none" ? rows : [...rows].sort(order)));
      });
    });
  };

  // Plots: what is pointed at.
  const tip = document.getElementById("tip");
  const hideTip = () => {
    tip.hidden = true;
    document.querySelectorAll(".point.on").forEach((point) => point.classList.remove("on"));
  };
  const showTip = (point) => {
    hideTip();
    point.classList.add("on");
    tip.textContent = point.dataset.tip.split("|").join("\n");
    tip.hidden = false;
    const at = point.getBoundingClientRect();
    const left = Math.min(at.right + 8, root.clientWidth - tip.offsetWidth - 8);
    const above = at.top - tip.offsetHeight - 6;
    tip.style.left = `${Math.max(8, left) + scrollX}px`;
    tip.style.top = `${(above < 4 ? at.bottom + 6 : above) + scrollY}px`;
  };
  // By mouse: point at a mark. By touch: the mark nearest to the finger. By keys: the tabulator key goes to the plot, arrows from mark to mark.
  const NEAR = 40;
  const preparePlot = (plot) => {
    const points = [...plot.querySelectorAll(".point[data-tip]")];
    points.forEach((point, number) => {
      point.querySelector("title").remove();
      point.addEventListener("pointerenter", () => showTip(point));
      point.addEventListener("pointerleave", hideTip);
      point.addEventListener("focus", () => showTip(point));
      point.addEventListener("blur", hideTip);
      point.addEventListener("keydown", (event) => {
        const to = { ArrowRight: number + 1, ArrowDown: number + 1, ArrowLeft: number - 1, ArrowUp: number - 1, Home: 0, End: points.length - 1 }[event.key];
        if (to === undefined || !points[to]) return;
        event.preventDefault();
        point.tabIndex = -1;
        points[to].tabIndex = 0;
        points[to].focus();
      });
    });
    const svg = plot.querySelector(":scope > svg");
    svg.addEventListener("click", (event) => {
      const away = (point) => {
        const box = point.querySelector(".reach").getBoundingClientRect();
        return Math.hypot(event.clientX - (box.left + box.right) / 2, event.clientY - (box.top + box.bottom) / 2);
      };
      const nearest = points.map((point) => [away(point), point]).sort((a, b) => a[0] - b[0])[0];
      if (nearest && nearest[0] < NEAR) showTip(nearest[1]); else hideTip();
    });
  };

  // Tables that are wider than the page scroll in their own box, and say so.
  const hintAt = (box) => {
    const cut = box.scrollWidth > box.clientWidth + 1;
    box.classList.toggle("cut", cut && box.scrollLeft + box.clientWidth < box.scrollWidth - 1);
    const hint = box.previousElementSibling;
    if (hint && hint.className === "more") hint.hidden = !cut;
  };

  // Pictures: two on each other, with a line between them that can be moved.
  const prepareComparison = (figure) => {
    const shots = [...figure.querySelectorAll(".shot")].map((shot) => ({
      image: shot.querySelector("img"),
      label: shot.querySelector("figcaption").textContent,
    }));
    if (shots.length < 2) return;
    const last = shots.length - 1;
    const stage = make("div", { className: "stage" });
    const [under, over] = [make("img", {}), make("img", { className: "over" })];
    const [left, right] = [make("span", { className: "l" }), make("span", { className: "r" })];
    const line = make("div", { className: "rule-line" });
    const slider = make("input", { type: "range", min: 0, max: 100, step: 0.5, value: 50, ariaLabel: "Where the line is" });
    const pick = (chosen, name) => {
      const select = make("select", { ariaLabel: name }, ...shots.map((shot, i) => make("option", { value: i }, shot.label)));
      select.value = chosen;
      return select;
    };
    const [first, second] = [pick(last - 1, "On the left"), pick(last, "On the right")];
    const move = () => {
      over.style.clipPath = `inset(0 0 0 ${slider.value}%)`;
      line.style.left = `${slider.value}%`;
    };
    const choose = () => {
      const [a, b] = [shots[first.value], shots[second.value]];
      Object.assign(under, { src: a.image.src, alt: a.image.alt, width: a.image.width, height: a.image.height });
      Object.assign(over, { src: b.image.src, alt: b.image.alt });
      left.textContent = a.label;
      right.textContent = b.label;
    };
    const drag = (event) => {
      if (!event.buttons) return;
      const box = stage.getBoundingClientRect();
      slider.value = (100 * (event.clientX - box.left)) / box.width;
      move();
    };
    slider.addEventListener("input", move);
    stage.addEventListener("pointerdown", drag);
    stage.addEventListener("pointermove", drag);
    stage.addEventListener("dragstart", (event) => event.preventDefault());
    [first, second].forEach((select) => select.addEventListener("change", choose));
    stage.append(under, over, line, left, right);
    figure.querySelector(".shots").replaceWith(stage, make("div", { className: "controls" }, first, slider, second));
    choose();
    move();
  };

  // What works is tried out if the address ends with #selftest; the result is an attribute of the root.
  const selfTest = () => {
    const faults = [];
    const check = (holds, what) => { if (!holds) faults.push(what); };
    const tables = [...document.querySelectorAll("table")];
    tables.forEach((table, number) => {
      const buttons = [...table.querySelectorAll("thead button")];
      const rows = () => [...table.tBodies[0].rows];
      const before = rows();
      buttons.forEach((button, column) => {
        const values = () => rows().map((row) => row.cells[column].dataset.v);
        const sorted = (sign) => values().filter((v) => v !== "").every((v, i, all) => i === 0 || sign * compare(all[i - 1], v) <= 0);
        const lastAreEmpty = () => values().join("\n").replace(/\n+$/, "").split("\n").every((v) => v !== "") || values().every((v) => v === "");
        button.click();
        check(sorted(1) && lastAreEmpty(), `table ${number} column ${column} does not sort up`);
        button.click();
        check(sorted(-1) && lastAreEmpty(), `table ${number} column ${column} does not sort down`);
        button.click();
        check(rows().every((row, i) => row === before[i]), `table ${number} column ${column} does not go back`);
      });
    });
    const points = [...document.querySelectorAll(".point[data-tip]")];
    points.forEach((point) => {
      point.dispatchEvent(new PointerEvent("pointerenter"));
      check(!tip.hidden && tip.textContent === point.dataset.tip.split("|").join("\n"), "a point has no tip");
      point.dispatchEvent(new PointerEvent("pointerleave"));
      check(tip.hidden, "a tip stays");
    });
    document.querySelectorAll(".plot").forEach((plot) => {
      const marks = [...plot.querySelectorAll(".point[data-tip]")];
      const stops = () => marks.filter((mark) => mark.tabIndex === 0);
      check(stops().length === 1, "a plot has not one stop of the tabulator key");
      const [first, next] = marks;
      first.dispatchEvent(new FocusEvent("focus"));
      check(!tip.hidden && first.classList.contains("on"), "a mark with the focus has no tip");
      first.dispatchEvent(new FocusEvent("blur"));
      if (next) {
        first.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight", cancelable: true }));
        check(stops()[0] === next && document.activeElement === next, "an arrow key does not go to the next mark");
        next.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft", cancelable: true }));
        check(stops()[0] === first, "an arrow key does not go back");
        first.blur();
      }
      const box = marks[marks.length - 1].querySelector(".reach").getBoundingClientRect();
      const [clientX, clientY] = [(box.left + box.right) / 2, (box.top + box.bottom) / 2];
      plot.querySelector(":scope > svg").dispatchEvent(new MouseEvent("click", { clientX, clientY }));
      check(!tip.hidden, "a tap beside a mark shows nothing");
      hideTip();
    });
    document.querySelectorAll(".scroll").forEach((box) => {
      const hint = box.previousElementSibling;
      check(hint.hidden === (box.scrollWidth <= box.clientWidth + 1), "a table that is cut does not say so");
    });
    const sliders = [...document.querySelectorAll(".controls input")];
    sliders.forEach((slider) => {
      const over = slider.closest(".compare").querySelector(".over");
      slider.value = 25;
      slider.dispatchEvent(new Event("input"));
      check(over.style.clipPath.includes("25%"), "a slider does not move");
      check(over.complete && over.naturalWidth > 0, "a picture is not shown");
      slider.value = 50;
      slider.dispatchEvent(new Event("input"));
    });
    const counts = `${tables.length} tables, ${points.length} points, ${sliders.length} sliders`;
    root.dataset.selftest = faults.length ? `failed: ${faults.join("; ")}` : `passed: ${counts}`;
  };

  document.querySelectorAll("table").forEach(prepareTable);
  document.querySelectorAll(".plot").forEach(preparePlot);
  const boxes = [...document.querySelectorAll(".scroll")];
  const hints = () => boxes.forEach(hintAt);
  boxes.forEach((box) => box.addEventListener("scroll", () => hintAt(box), { passive: true }));
  document.querySelectorAll("details").forEach((details) => details.addEventListener("toggle", hints));
  addEventListener("resize", hints);
  hints();
  document.querySelectorAll(".compare").forEach(prepareComparison);
  addEventListener("keydown", (event) => { if (event.key === "Escape") hideTip(); });
  root.dataset.ready = "yes";
  // After the pictures.
  if (location.hash === "#selftest") addEventListener("load", () => setTimeout(selfTest, 50));
})();
