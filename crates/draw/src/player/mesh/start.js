
/** Every player of the page, each with the scene inside it. */
for (const root of document.querySelectorAll(".player")) {
  const tell = text => { const empty = root.querySelector(".empty"); empty.textContent = text; empty.hidden = false; };
  const scene = JSON.parse(root.querySelector("script").textContent);
  if (!window.DecompressionStream || !window.WebGL2RenderingContext)
    tell("This page needs WebGL 2 and DecompressionStream, which this browser does not have: use one from 2023 or later.");
  else {
    tell("Unpacking the meshes …");
    Promise.all(scene.figures.map(unpack)).then(
      figures => {
        root.querySelector(".empty").hidden = true;
        if (!player(root, scene, figures)) tell("This page needs WebGL 2, which is switched off in this browser or not supported by its graphics driver.");
      },
      error => tell("The meshes in this page are damaged: " + error.message));
  }
}
