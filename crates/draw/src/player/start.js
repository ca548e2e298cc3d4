
/** Every player of the page, each with the scene inside it. */
for (const root of document.querySelectorAll(".player")) player(root, JSON.parse(root.querySelector("script").textContent));
