// The page: time, camera, what is shown.

const element = (id) => document.getElementById(id);

class Viewer {
  constructor(scene) {
    this.scene = scene;
    this.canvas = element("canvas");
    this.drawing = new Drawing(this.canvas, scene.gaussians, scene.limits);
    this.frame = 0;
    this.free = null;  // the camera once it was moved; null: that of the recording
    this.playing = false;
    this.shown = { masks: false, displacement: false, hidden: [] };
    this.stale = true;  // whether the state must be filled anew
    this.waiting = false;
    new ResizeObserver(() => this.redraw()).observe(this.canvas);
    this.show();
  }

  // Draw with the next picture of the screen; `anew`: the Gaussians changed too.
  redraw(anew = false) {
    this.stale ||= anew;
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame((now) => {
      this.waiting = false;
      if (this.playing) this.advance(now);
      this.drawNow();
    });
  }

  drawNow() {
    const ratio = window.devicePixelRatio, { canvas, drawing } = this;
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio)), height = Math.max(1, Math.round(canvas.clientHeight * ratio));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    if (this.stale) {
      fill(drawing.state, this.scene, this.frame, this.shown);
      drawing.upload();
      this.stale = false;
    }
    drawing.draw(letterboxed(this.camera(), this.scene.size, canvas), this.free === null);
  }

  camera() {
    return this.free ?? this.scene.cameras[Math.round(this.frame)];
  }

  // Time

  goTo(frame) {
    this.frame = Math.min(this.scene.lastFrame, Math.max(0, frame));
    this.show();
    this.redraw(true);
  }

  play(playing) {
    this.playing = playing && this.scene.lastFrame > 0;
    this.last = performance.now();
    this.show();
    this.redraw();
  }

  advance(now) {
    const next = this.frame + (Math.max(0, now - this.last) / 1000) * this.scene.fps;
    this.last = now;
    this.goTo(next > this.scene.lastFrame ? 0 : next);
  }

  // Camera

  move(change) {
    this.free = change(this.camera());
    this.show();
    this.redraw();
  }

  lock() {
    this.free = null;
    this.show();
    this.redraw();
  }

  // What is shown

  change(changes) {
    Object.assign(this.shown, changes);
    this.show();
    this.redraw(true);
  }

  // Let the controls say what is.
  show() {
    const { scene, shown } = this;
    element("time").value = this.frame;
    element("clock").value = `frame ${this.frame.toFixed(1)} of ${scene.lastFrame} · ${(this.frame / scene.fps).toFixed(2)} s`;
    element("play").textContent = this.playing ? "⏸" : "▶";
    element("play").ariaLabel = this.playing ? "Pause" : "Play";
    element("surgeon").disabled = this.free === null;
    element("showMasks").checked = shown.masks;
    element("showDisplacement").checked = shown.displacement;
    element("prompts").hidden = !shown.masks;
    for (const id of ["scale", "low", "high", "meaning"]) element(id).hidden = !shown.displacement;
  }
}

function describe(viewer) {
  const { name, unit, masks, displacement, referenceFrame, lastFrame } = viewer.scene;
  element("name").textContent = name;
  element("time").max = lastFrame;
  element("play").disabled = element("time").disabled = lastFrame === 0;
  element("masks").hidden = masks.length === 0;
  masks.forEach(({ text, colour }, k) => {
    const label = document.createElement("label"), box = document.createElement("input"), swatch = document.createElement("span");
    box.type = "checkbox";
    box.checked = true;
    box.addEventListener("change", () => {
      viewer.shown.hidden[k] = !box.checked;
      viewer.redraw(true);
    });
    swatch.className = "swatch";
    swatch.style.background = `rgb(${colour})`;
    label.append(box, swatch, text);
    element("prompts").appendChild(document.createElement("li")).append(label);
  });
  const colours = [0, 51, 102, 153, 204, 255].map((place) => `rgb(${displacement.colours.slice(place * 3, place * 3 + 3)})`);
  element("scale").style.background = `linear-gradient(to right, ${colours})`;
  element("low").textContent = `0 ${unit}`;
  element("high").textContent = `≥ ${displacement.high.toPrecision(3)} ${unit}`;
  element("meaning").textContent = `How far each place has moved since frame ${referenceFrame}. Greyish: a guess, the recording does not show it.`;
}

function listen(viewer) {
  const { canvas, scene } = viewer;
  element("play").addEventListener("click", () => viewer.play(!viewer.playing));
  element("surgeon").addEventListener("click", () => viewer.lock());
  element("time").addEventListener("input", (event) => {
    const frame = event.target.valueAsNumber;
    viewer.play(false);
    viewer.goTo(frame);
  });
  element("showMasks").addEventListener("change", (event) => viewer.change({ masks: event.target.checked }));
  element("showDisplacement").addEventListener("change", (event) => viewer.change({ displacement: event.target.checked }));

  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointermove", (event) => {
    if (!canvas.hasPointerCapture(event.pointerId)) return;
    const [dx, dy] = [event.movementX, event.movementY];
    const scale = Math.max(scene.size[0] / canvas.clientWidth, scene.size[1] / canvas.clientHeight);
    if (event.shiftKey || event.buttons === 2) viewer.move((camera) => pan(camera, scene.pivot, dx * scale, dy * scale));
    else viewer.move((camera) => orbit(camera, scene.pivot, -dx * 0.006, dy * 0.006));
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    viewer.move((camera) => dolly(camera, scene.pivot, Math.exp(Math.max(-100, Math.min(100, event.deltaY)) * 0.001)));
  }, { passive: false });

  const turn = (yaw, pitch) => viewer.move((camera) => orbit(camera, scene.pivot, yaw, pitch));
  const keys = {
    " ": () => viewer.play(!viewer.playing),
    ArrowLeft: () => viewer.goTo(Math.ceil(viewer.frame) - 1),
    ArrowRight: () => viewer.goTo(Math.floor(viewer.frame) + 1),
    v: () => viewer.lock(),
    m: () => scene.masks.length && viewer.change({ masks: !viewer.shown.masks }),
    d: () => viewer.change({ displacement: !viewer.shown.displacement }),
    "+": () => viewer.move((camera) => dolly(camera, scene.pivot, 0.9)),
    "-": () => viewer.move((camera) => dolly(camera, scene.pivot, 1 / 0.9)),
  };
  const turns = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
  document.addEventListener("keydown", (event) => {
    const operated = event.key === " " && ["button", "checkbox", "submit"].includes(event.target.type);
    if (operated || event.altKey || event.metaKey) return;
    const act = event.ctrlKey ? turns[event.key] && (() => turn(...turns[event.key])) : keys[event.key];
    if (act) {
      event.preventDefault();
      act();
    }
  });
}

async function start() {
  try {
    if (typeof DecompressionStream === "undefined") throw new Error("This browser is too old to unpack the scene.");
    const viewer = new Viewer(await readScene());
    describe(viewer);
    listen(viewer);
    viewer.drawNow();
    document.body.className = "";
  } catch (error) {
    document.body.className = "failed";
    element("message").textContent = error.message;
  }
}
start();
