// Says what a browser makes of a report, to the page around it: `KEY VALUE` pairs.
addEventListener("load", () => {
  const shown = [...document.querySelectorAll("figure > svg")].filter(svg => svg.getBoundingClientRect().width > 0);
  const texts = shown.flatMap(svg => [...svg.querySelectorAll("text")]);

  // The size of a letter as it is seen, in pixels.
  const size = text => {
    const svg = text.closest("figure > svg");
    return text.getAttribute("font-size") * svg.getBoundingClientRect().width / svg.viewBox.baseVal.width;
  };

  const luminance = color => {
    const [r, g, b] = color.match(/[\d.]+/g).map(part => {
      const share = part / 255;
      return share <= 0.03928 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const contrast = (a, b) => {
    const [light, dark] = [luminance(a), luminance(b)].sort((x, y) => y - x);
    return (light + 0.05) / (dark + 0.05);
  };
  const style = element => getComputedStyle(element);
  const paper = style(document.querySelector("section")).backgroundColor;
  const inks = texts.map(text => style(text).fill).concat(
    [...document.querySelectorAll("p, li, td, th, a, h1, h2, h3, figcaption")].map(text => style(text).color));

  // Tables and commands scroll in their own frame; nothing else may reach beyond the page.
  const beyond = [...document.querySelectorAll("body *")].filter(
    element => !element.closest(".wide, pre, svg") && element.getBoundingClientRect().right > innerWidth + 1);

  // A table that is wider than its frame is cut until it is scrolled.
  const cut = [...document.querySelectorAll(".wide")].filter(frame => frame.scrollWidth > frame.clientWidth + 1);

  parent.postMessage([
    "width", innerWidth,
    "scheme", matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light",
    "paper", luminance(paper) < 0.2 ? "dark" : "light",
    "pictures", shown.length,
    "beyond", beyond.length,
    "letters", Math.floor(10 * Math.min(...texts.map(size))) / 10,
    "contrast", Math.floor(10 * Math.min(...inks.map(ink => contrast(ink, paper)))) / 10,
    "requests", performance.getEntriesByType("resource").length,
    "cut", cut.length,
  ].join(" "), "*");
});
