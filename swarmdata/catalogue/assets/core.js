// The namespace of the catalogue: the page's data, elements without HTML text, copying, numbers.
"use strict";
window.swarmdata = (() => {
  const page = JSON.parse(document.getElementById("page-data").textContent);
  const SVG = "http://www.w3.org/2000/svg";

  function build(node, attributes, children) {
    for (const [name, value] of Object.entries(attributes || {})) {
      if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
      else if (value === true) node.setAttribute(name, "");
      else if (value !== false && value !== null && value !== undefined) node.setAttribute(name, value);
    }
    node.append(...children.filter((child) => child !== null && child !== undefined));
    return node;
  }

  // Text becomes text nodes, so nothing that comes from data is read as HTML.
  const el = (name, attributes, ...children) => build(document.createElement(name), attributes, children);
  const svg = (name, attributes, ...children) =>
    build(document.createElementNS(SVG, name), attributes, children);

  async function copyText(text) {
    if (navigator.clipboard && window.isSecureContext) {
      try {
        await navigator.clipboard.writeText(text);
        return true;
      } catch (refused) {
        // not permitted here: the older way follows
      }
    }
    const area = el("textarea", { "aria-hidden": "true", class: "offscreen" });
    area.value = text;
    document.body.append(area);
    area.select();
    const copied = document.execCommand("copy");
    area.remove();
    return copied;
  }

  async function copyFrom(button, text) {
    const label = button.textContent;
    button.textContent = (await copyText(text)) ? "Copied" : "Press Ctrl-C";
    setTimeout(() => {
      button.textContent = label;
    }, 1500);
  }

  for (const button of document.querySelectorAll("button[data-copies]")) {
    const source = document.getElementById(button.dataset.copies);
    button.addEventListener("click", () => copyFrom(button, source.textContent));
  }

  const number = (value, digits) =>
    value.toLocaleString("en", { minimumFractionDigits: digits, maximumFractionDigits: digits });

  // What pages call the reasons why episodes end.
  const outcomes = { success: "solved", failure: "failed", horizon: "out of time", ended: "ended", unsolved: "not solved" };

  // What is said of a measured episode without a replay.
  const absent = ({ episodes }, position) =>
    `Episode ${episodes.number[position]} of ${episodes.policies[episodes.policy[position]]} ${page.absent}`;

  // What the address says after its #: name=value pairs. Others, such as #content, are places.
  const isPlace = () => location.hash.length > 1 && !location.hash.includes("=");
  const address = () => new URLSearchParams(isPlace() ? "" : location.hash.slice(1));

  // Back, Forward, and links to another choice; a link to a place in the page changes nothing.
  const onAddress = (follow) => addEventListener("popstate", () => {
    if (!isPlace()) follow();
  });

  return { page, el, svg, address, onAddress, copyFrom, number, outcomes, absent };
})();
