"use strict";
// Elements, numbers and tables of the report and of the page of Lai et al.'s tables.

const results = JSON.parse(document.getElementById("results").textContent);
const TASKS = { dense: "Dense noise", sparse: "Sparse noise", complete: "Completion" };

/** Sets attributes and appends children: elements or text. */
function fill(node, attributes, children) {
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
}
const html = (tag, attributes = {}, ...children) => fill(document.createElement(tag), attributes, children);

/** Three significant digits, at most six decimals. */
function short(value) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const digits = 2 - Math.floor(Math.log10(Math.max(Math.abs(value), 1e-5)));
  return value.toFixed(Math.min(6, Math.max(0, digits)));
}
const range = ([low, high]) => `${short(low)} to ${short(high)}`;
const plural = (count, noun) => `${count} ${noun}${count === 1 ? "" : "s"}`;
const unique = list => [...new Set(list)];

function table(head, rows) {
  const cells = (tag, list) => list.map(c => c instanceof Node ? c : html(tag, {}, c));
  return html("div", { class: "wide" }, html("table", {},
    html("thead", {}, ...head.map(line => html("tr", {}, ...cells("th", line)))),
    html("tbody", {}, ...rows.map(line => html("tr", {}, ...cells("td", line))))));
}
const named = (tag, text) => html(tag, { class: "name" }, text);
const pale = text => html("td", { class: "pale" }, text);
