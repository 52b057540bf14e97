// Gaussians on a canvas, with WebGL2: sorted, farthest first, and blended.

const TEXTURE_WIDTH = 4096;

class Drawing {
  constructor(canvas, count, limits) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false });
    if (!gl) throw new Error("This browser cannot show the scene: it offers no WebGL2.");
    this.gl = gl;
    this.count = count;
    this.program = linked(gl, ["vertexShader", "fragmentShader"].map((id) => document.getElementById(id).textContent.trim()));
    gl.useProgram(this.program);
    this.place = Object.fromEntries(["view", "focal", "principal", "size", "gaussians", ...Object.keys(limits)].map((name) => [name, gl.getUniformLocation(this.program, name)]));
    for (const [name, value] of Object.entries(limits)) gl.uniform1f(this.place[name], value);

    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    this.rows = Math.max(1, Math.ceil((count * 4) / TEXTURE_WIDTH));
    if (this.rows > gl.getParameter(gl.MAX_TEXTURE_SIZE)) throw new Error("This browser cannot show so many Gaussians.");
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, TEXTURE_WIDTH, this.rows);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    this.state = new Float32Array(TEXTURE_WIDTH * this.rows * 4);

    this.order = new Uint32Array(count);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    const index = gl.getAttribLocation(this.program, "gaussian");
    gl.enableVertexAttribArray(index);
    gl.vertexAttribIPointer(index, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(index, 1);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  // `this.state` was filled anew.
  upload() {
    this.gl.texSubImage2D(this.gl.TEXTURE_2D, 0, 0, 0, TEXTURE_WIDTH, this.rows, this.gl.RGBA, this.gl.FLOAT, this.state);
  }

  // Draw from a camera; with `cropped` only what lies in its picture.
  draw(camera, cropped) {
    const { gl, place } = this, { width, height } = gl.canvas;
    sortByDepth(this.order, this.state, camera.view);
    gl.bufferData(gl.ARRAY_BUFFER, this.order, gl.DYNAMIC_DRAW);
    gl.viewport(0, 0, width, height);
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(0, 0, 0, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    if (cropped) {
      const [wide, high] = camera.picture.map(Math.round);
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(Math.round((width - wide) / 2), Math.round((height - high) / 2), wide, high);
    }
    gl.uniformMatrix4fv(place.view, true, camera.view);
    gl.uniform2f(place.focal, camera.fx, camera.fy);
    gl.uniform2f(place.principal, camera.cx, camera.cy);
    gl.uniform2f(place.size, width, height);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, this.count);
  }
}

function linked(gl, sources) {
  const program = gl.createProgram();
  [gl.VERTEX_SHADER, gl.FRAGMENT_SHADER].forEach((kind, i) => {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, sources[i]);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  });
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  return program;
}
