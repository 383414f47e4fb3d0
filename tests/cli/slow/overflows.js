// Elements that reach beyond the page and are in nothing that scrolls.
(() => {
  const width = document.documentElement.clientWidth;
  const found = [];
  for (const element of document.body.querySelectorAll("*")) {
    if (element.closest("svg") && element.tagName !== "svg") continue;
    if (!element.checkVisibility() || element.closest(".scroll")?.contains(element) && !element.matches(".scroll")) continue;
    const box = element.getBoundingClientRect();
    if (box.right > width + 0.5 || box.left < -0.5) found.push(`${element.tagName}.${element.getAttribute("class")}: ${box.left} to ${box.right}`);
  }
  return { page: document.documentElement.scrollWidth, width, found };
})()
