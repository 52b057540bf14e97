// Cameras: { fx, fy, cx, cy, view }, a pinhole in pixels and the row-major map from world to camera (x right, y down, z forward).

// The camera that shows the whole of a picture of size [width, height], centred, in a canvas.
function letterboxed(camera, [width, height], canvas) {
  const scale = Math.min(canvas.width / width, canvas.height / height);
  return {
    ...camera,
    fx: camera.fx * scale,
    fy: camera.fy * scale,
    cx: (camera.cx - width / 2) * scale + canvas.width / 2,
    cy: (camera.cy - height / 2) * scale + canvas.height / 2,
    picture: [width * scale, height * scale],
  };
}

function moved(view, [x, y, z]) {
  const result = [...view];
  [result[3], result[7], result[11]] = [view[3] + x, view[7] + y, view[11] + z];
  return result;
}

function inCamera(view, [x, y, z]) {
  return [0, 4, 8].map((row) => view[row] * x + view[row + 1] * y + view[row + 2] * z + view[row + 3]);
}

// Turn about a point of the world, which keeps its place in the picture; radians.
function orbit(camera, pivot, yaw, pitch) {
  const centre = inCamera(camera.view, pivot);
  const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  const turn = [[cy, 0, -sy], [-sp * sy, cp, -sp * cy], [cp * sy, sp, cp * cy]];
  const away = moved(camera.view, centre.map((value) => -value));
  const view = [...away];
  for (let row = 0; row < 3; row++)
    for (let column = 0; column < 4; column++)
      view[row * 4 + column] = turn[row].reduce((sum, factor, k) => sum + factor * away[k * 4 + column], 0);
  return { ...camera, view: moved(view, centre) };
}

// Shift sideways, so that a point of the world moves by so many pixels.
function pan(camera, pivot, dx, dy) {
  const depth = inCamera(camera.view, pivot)[2];
  return { ...camera, view: moved(camera.view, [(dx * depth) / camera.fx, (dy * depth) / camera.fy, 0]) };
}

// Come closer (factor < 1) or back off: the depth of a point of the world is multiplied.
function dolly(camera, pivot, factor) {
  return { ...camera, view: moved(camera.view, [0, 0, inCamera(camera.view, pivot)[2] * (factor - 1)]) };
}
