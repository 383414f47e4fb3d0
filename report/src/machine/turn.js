// Turns the drawings of machines. Each element carries its points in space (data-p); the projection is that of the
// drawing as it was written, so without this script it stands as it is.
for (const figure of document.querySelectorAll(".machine-figure")) {
  const svg = figure.querySelector("svg.machine");
  const [azimuth, elevation, ...rest] = svg.dataset.view.split(" ").map(Number);
  const [centre, scale, corner] = [rest.slice(0, 3), rest[3], rest.slice(4)];
  const [width, height] = [svg.viewBox.baseVal.width, svg.viewBox.baseVal.height];
  const elements = [...svg.querySelectorAll("[data-p]")].map((element) => {
    const numbers = element.dataset.p.split(" ").map(Number);
    const points = [];
    for (let i = 0; i < numbers.length; i += 3) points.push(numbers.slice(i, i + 3));
    return { element, points, inCorner: !!element.closest(".axes"), closed: (element.getAttribute("d") || "").endsWith("Z") };
  });
  const view = { azimuth, elevation };

  function project() {
    const [sa, ca] = [Math.sin(view.azimuth), Math.cos(view.azimuth)];
    const [se, ce] = [Math.sin(view.elevation), Math.cos(view.elevation)];
    const flat = (p) => [-sa * p[0] + ca * p[1], se * ca * p[0] + se * sa * p[1] - ce * p[2]];
    const depth = (p) => ce * ca * p[0] + ce * sa * p[1] + se * p[2];
    const offset = (p) => p.map((value, axis) => value - centre[axis]);
    // Smaller where it would not fit otherwise.
    let reach = [1e-9, 1e-9];
    for (const { points, inCorner } of elements) {
      if (inCorner) continue;
      for (const point of points) flat(offset(point)).forEach((value, k) => (reach[k] = Math.max(reach[k], Math.abs(value))));
    }
    const s = Math.min(scale, (0.5 * width - 30) / reach[0], (0.5 * height - 22) / reach[1]);
    for (const { element, points, inCorner, closed } of elements) {
      const at = points.map((point) => {
        const [x, y] = flat(inCorner ? point : offset(point));
        const origin = inCorner ? corner : [width / 2, height / 2];
        return [origin[0] + s * x, origin[1] + s * y].map((value) => value.toFixed(1));
      });
      const [x, y] = at[0];
      if (element.tagName === "path") element.setAttribute("d", "M" + at.map((p) => p.join(" ")).join("L") + (closed ? "Z" : ""));
      else if (element.tagName === "circle") (element.setAttribute("cx", x), element.setAttribute("cy", y));
      else if (element.tagName === "text") (element.setAttribute("x", x), element.setAttribute("y", y));
      else {
        const shift = element.dataset.shift.split(" ").map(Number);
        element.setAttribute("transform", `translate(${Number(x) + shift[0]} ${Number(y) + shift[1]})`);
      }
    }
    for (const group of svg.querySelectorAll(".sorted")) {
      const far = (g) => {
        const p = g.querySelector("[data-p]").dataset.p.split(" ").map(Number);
        return depth(p.slice(0, 3)) + depth(p.slice(3, 6));
      };
      [...group.children].sort((a, b) => far(a) - far(b)).forEach((child) => group.append(child));
    }
  }

  function turn(left, up) {
    view.azimuth += left;
    view.elevation = Math.min(Math.max(view.elevation + up, 0), Math.PI / 2);
    project();
  }

  let last = null;
  svg.addEventListener("pointerdown", (event) => {
    last = [event.clientX, event.clientY];
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", (event) => {
    if (!last) return;
    turn((last[0] - event.clientX) * 0.008, (event.clientY - last[1]) * 0.008);
    last = [event.clientX, event.clientY];
  });
  for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => (last = null));

  const step = Math.PI / 12;
  const moves = { left: [-step, 0], right: [step, 0], up: [0, step], down: [0, -step] };
  const controls = figure.querySelector(".turn");
  for (const button of controls.querySelectorAll("button")) {
    button.addEventListener("click", () => {
      const move = moves[button.value];
      if (move) turn(...move);
      else (Object.assign(view, { azimuth, elevation }), project());
    });
  }
  controls.hidden = false;
  svg.classList.add("turns");
}
