// A trunk to turn: every state has the same vertices, so any two of them are blended on the graphics card.
(async () => {
  const root = document.getElementById('turning');
  const at = name => root.querySelector('[data-part=' + name + ']');
  const canvas = at('canvas');
  const gl = canvas.getContext('webgl2', {antialias: true, alpha: false});
  if (!gl || !self.DecompressionStream) return;  // the page has pictures, too
  const info = JSON.parse(at('info').textContent);
  const packed = Uint8Array.from(atob(at('data').textContent.trim()), c => c.charCodeAt(0));
  const inflated = new Blob([packed]).stream().pipeThrough(new DecompressionStream('deflate'));
  const bytes = new Uint8Array(await new Response(inflated).arrayBuffer());

  // Numbers of 16 bits: differences from the one before, folded to be positive, all low bytes and then all high ones.
  let read = 0;
  const numbers = count => {
    const found = new Uint16Array(count);
    for (let i = 0, last = 0; i < count; i++) {
      const folded = bytes[read + i] | bytes[read + count + i] << 8;
      found[i] = last = last + (folded >> 1 ^ -(folded & 1)) & 0xffff;
    }
    read += 2 * count;
    return found;
  };
  const points = (count, base) => {
    const found = new Float32Array(3 * count);
    for (let axis = 0; axis < 3; axis++) {
      const raw = numbers(count);
      for (let i = 0; i < count; i++)
        found[3 * i + axis] = base ? base[3 * i + axis] + info.step * (raw[i] << 16 >> 16)
                                   : info.step * raw[i] - info.middle[axis];
    }
    return found;
  };
  const normals = (vertices, faces) => {
    const sum = new Float32Array(vertices.length), v = vertices;
    for (let i = 0; i < faces.length; i += 3) {
      const a = 3 * faces[i], b = 3 * faces[i + 1], c = 3 * faces[i + 2];
      const ux = v[b] - v[a], uy = v[b + 1] - v[a + 1], uz = v[b + 2] - v[a + 2];
      const wx = v[c] - v[a], wy = v[c + 1] - v[a + 1], wz = v[c + 2] - v[a + 2];
      const x = uy * wz - uz * wy, y = uz * wx - ux * wz, z = ux * wy - uy * wx;
      for (const k of [a, b, c]) { sum[k] += x; sum[k + 1] += y; sum[k + 2] += z; }
    }
    return sum;  // the shader gives them length 1
  };
  const mesh = (count, faces) => {
    const states = [], indices = new Uint32Array(3 * faces);
    const low = numbers(3 * faces), high = numbers(3 * faces);
    for (let i = 0; i < indices.length; i++) indices[i] = low[i] | high[i] << 16;
    for (const _ of info.states) {
      const place = points(count, states.length ? states[0].place : null);
      states.push({place, normal: normals(place, indices)});
    }
    return {count, indices, states};
  };
  const skin = mesh(info.vertices, info.faces), cloth = mesh(info.cloth, info.clothFaces);
  for (const state of skin.states) {
    const height = numbers(skin.count), part = numbers(skin.count);
    state.hump = new Float32Array(2 * skin.count);
    for (let i = 0; i < skin.count; i++) {
      state.hump[2 * i] = (height[i] << 16 >> 16) / 4;
      state.hump[2 * i + 1] = part[i] / 31;
    }
  }
  cloth.inside = Float32Array.from(numbers(cloth.count), n => (n << 16 >> 16) / 10);
  if (info.coloured) {
    skin.colour = new Float32Array(3 * skin.count);
    for (let axis = 0; axis < 3; axis++)
      numbers(skin.count).forEach((c, i) => { skin.colour[3 * i + axis] = c / 255; });
  }
  if (info.invented) skin.inside = Float32Array.from(numbers(skin.count));

  const vertexShader = `#version 300 es
    in vec3 a, b, na, nb, colour; in vec2 ha, hb; in float inside;
    uniform float t; uniform mat3 turn; uniform vec2 scale; uniform float depth;
    out vec3 normal, own; out vec2 hump; out float edge;
    void main() {
      vec3 p = turn * mix(a, b, t);
      normal = turn * mix(normalize(na), normalize(nb), t);
      hump = mix(ha, hb, t); own = colour; edge = inside;
      gl_Position = vec4(p.xy * scale, -p.z / depth, 1.0);
    }`;
  const fragmentShader = `#version 300 es
    precision highp float;
    in vec3 normal, own; in vec2 hump; in float edge;
    uniform int material, whole, invented; uniform float showHump, limit; uniform vec3 palette[${info.palette.length / 3}];
    out vec4 colour;
    void main() {
      vec3 n = normalize(normal), base;
      float seen = 1.0;
      if (material == 0) {
        base = own;
        int last = palette.length() - 1;  // the first and the last colour lie beyond the scale
        int step = int(floor((hump.x / limit + 1.0) * 0.5 * float(last - 1))) + 1;
        base = mix(base, palette[clamp(step, 0, last)], showHump * hump.y);
        if (edge > 0.5) base = vec3(0.62);
      } else {
        base = material == 1 ? vec3(0.36, 0.42, 0.48) : vec3(0.62, 0.71, 0.78);
        if (whole == 0) seen = clamp(edge / max(fwidth(edge), 1e-4) + 0.5, 0.0, 1.0);
        if (seen < 0.01) discard;
      }
      bool guessed = invented == 1 && (material == 2 || (material == 0 && edge > 0.5));  // hatched, as in the pictures
      if (guessed && mod(gl_FragCoord.x + gl_FragCoord.y, 12.0) < 2.0) base = vec3(0.13);
      float light = gl_FrontFacing ? clamp(dot(n, vec3(0.0, 0.57, 0.82)), 0.0, 1.0) : 0.6;  // the inside of cloth is even
      colour = vec4((vec3(0.36, 0.33, 0.31) + vec3(0.64, 0.67, 0.69) * light) * base, seen);
    }`;
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertexShader], [gl.FRAGMENT_SHADER, fragmentShader]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  const uniform = name => gl.getUniformLocation(program, name);
  const buffer = (data, kind = gl.ARRAY_BUFFER) => {
    const made = gl.createBuffer();
    gl.bindBuffer(kind, made);
    gl.bufferData(kind, data, gl.STATIC_DRAW);
    return made;
  };
  for (const part of [skin, cloth]) {
    part.index = buffer(part.indices, gl.ELEMENT_ARRAY_BUFFER);
    for (const state of part.states)
      for (const name of ['place', 'normal', 'hump']) if (state[name]) state[name] = buffer(state[name]);
    for (const name of ['inside', 'colour']) if (part[name]) part[name] = buffer(part[name]);
  }
  const feed = (name, data, size, other = [0, 0, 0]) => {
    const place = gl.getAttribLocation(program, name);
    if (place < 0) return;
    if (!data) {
      gl.disableVertexAttribArray(place);
      gl.vertexAttrib3fv(place, other);
      return;
    }
    gl.bindBuffer(gl.ARRAY_BUFFER, data);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, size, gl.FLOAT, false, 0, 0);
  };
  gl.enable(gl.DEPTH_TEST);
  gl.enable(gl.SAMPLE_ALPHA_TO_COVERAGE);
  gl.clearColor(1, 1, 1, 1);
  gl.uniform3fv(uniform('palette'), info.palette);
  gl.uniform1f(uniform('limit'), info.limit);
  gl.uniform1i(uniform('invented'), info.invented ? 1 : 0);

  // Patient axes: +x left, +y back, +z up. Yaw 0 is seen from behind, a quarter more from the patient's right.
  const shades = [];  // of the scale, in equal parts
  for (let i = 0; i < info.palette.length; i += 3)
    shades.push(`rgb(${info.palette.slice(i, i + 3).map(c => Math.round(255 * c))}) 0 ${100 * (i + 3) / info.palette.length}%`);
  at('scale').style.background = `linear-gradient(to right, ${shades})`;

  const view = {yaw: 0, pitch: 0}, look = {hump: false, shirt: false, bare: false, wipe: false, own: true};
  const slider = at('slider'), ends = [at('from'), at('to')];
  const chosen = end => end.value === undefined ? +end.dataset.state : +end.value;
  const size = Math.hypot(...info.size);
  const turn = () => {
    const c = Math.cos(view.yaw), s = Math.sin(view.yaw), u = Math.cos(view.pitch), w = Math.sin(view.pitch);
    return [-c, s * w, -s * u, -s, -c * w, c * u, 0, u, w];  // columns: where x, y and z of the patient go
  };
  const drawTrunk = (blend, from, to) => {
    gl.uniform1f(uniform('t'), blend);
    for (const part of [skin, cloth]) {
      if (part === cloth && look.bare) continue;
      const a = part.states[from], b = part.states[to];
      feed('a', a.place, 3); feed('b', b.place, 3); feed('na', a.normal, 3); feed('nb', b.normal, 3);
      feed('ha', a.hump, 2); feed('hb', b.hump, 2); feed('inside', part.inside, 1);
      feed('colour', look.own && part.colour, 3, [0.96, 0.93, 0.90]);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, part.index);
      const pieces = part === skin ? [[0, 0, info.faces]]
        : [[1, 0, info.shortsFaces], [2, info.shortsFaces, info.clothFaces - info.shortsFaces]];
      for (const [material, first, count] of pieces) {
        gl.uniform1i(uniform('material'), material);
        gl.drawElements(gl.TRIANGLES, 3 * count, gl.UNSIGNED_INT, 12 * first);
      }
    }
  };
  const side = () => {
    if (view.pitch > 1.2) return ['left', 'right', 'above'];
    const quarter = ((Math.round(view.yaw / (Math.PI / 2)) % 4) + 4) % 4;
    return [['left', 'right', 'behind'], ['back', 'front', 'the right side'], ['right', 'left', 'the front'],
            ['front', 'back', 'the left side']][quarter];
  };
  const draw = () => {
    const ratio = Math.min(devicePixelRatio, 2);
    const wide = Math.round(canvas.clientWidth * ratio), tall = Math.round(canvas.clientHeight * ratio);
    if (!wide) return;
    if (canvas.width !== wide || canvas.height !== tall) { canvas.width = wide; canvas.height = tall; }
    gl.viewport(0, 0, wide, tall);
    gl.disable(gl.SCISSOR_TEST);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const pixels = 0.96 * Math.min(tall / info.size[2], wide / Math.max(info.size[0], info.size[1]));  // for each mm
    gl.uniformMatrix3fv(uniform('turn'), false, turn());
    gl.uniform2f(uniform('scale'), 2 * pixels / wide, 2 * pixels / tall);
    gl.uniform1f(uniform('depth'), size);
    gl.uniform1i(uniform('whole'), look.shirt ? 1 : 0);
    gl.uniform1f(uniform('showHump'), look.hump ? 1 : 0);
    const blend = slider.value / slider.max, [from, to] = ends.map(chosen);
    if (look.wipe) {  // under the handle: what stands on the left of the slider on its left
      const edge = Math.round(blend * wide);
      gl.enable(gl.SCISSOR_TEST);
      gl.scissor(0, 0, edge, tall);
      drawTrunk(0, from, to);
      gl.scissor(edge, 0, wide - edge, tall);
      drawTrunk(1, from, to);
      gl.scissor(edge - ratio, 0, 2 * ratio, tall);
      gl.clearColor(0.1, 0.1, 0.1, 1);
      gl.clear(gl.COLOR_BUFFER_BIT);
      gl.clearColor(1, 1, 1, 1);
    } else drawTrunk(blend, from, to);
    const names = [from, to].map(n => info.states[n]), [left, right, seen] = side();
    at('left').textContent = left;
    at('right').textContent = right;
    at('wiped').textContent = look.wipe && blend > 0 ? names[0] : '';
    at('kept').textContent = look.wipe && blend < 1 ? names[1] : '';
    at('key').hidden = !look.hump;
    at('hides').textContent = look.shirt && !look.bare ? 'The close shirt hides these colours.' : '';
    at('bar').style.width = 100 * pixels / ratio + 'px';
    const shown = look.wipe || (blend > 0 && blend < 1) ? names[0] + ' and ' + names[1] : names[+(blend > 0.5)];
    canvas.setAttribute('aria-label', 'The trunk, ' + shown + ', seen from ' + seen);
    slider.setAttribute('aria-valuetext', look.wipe
      ? names[0] + ' on the left ' + Math.round(100 * blend) + ' % of the picture, ' + names[1] + ' on the right'
      : Math.round(100 * blend) + ' % of the way to: ' + names[1]);
    for (const button of root.querySelectorAll('[data-yaw]'))
      button.setAttribute('aria-pressed', Math.abs(Math.sin((view.yaw - button.dataset.yaw) / 2)) < 1e-3
        && Math.abs(view.pitch - button.dataset.pitch) < 1e-3);
    root.dataset.yaw = view.yaw;
    root.dataset.pitch = view.pitch;
  };
  let waiting = false;
  const show = () => {  // one picture for each frame of the screen
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => { waiting = false; draw(); });
  };
  const move = (yaw, pitch) => {
    view.yaw += yaw;
    view.pitch = Math.max(-0.5, Math.min(Math.PI / 2, view.pitch + pitch));
    show();
  };
  let held = null;
  canvas.addEventListener('pointerdown', event => { held = event; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener('pointermove', event => {
    if (!held || event.pointerId !== held.pointerId) return;
    move((held.clientX - event.clientX) * 0.01, (event.clientY - held.clientY) * 0.006);
    held = event;
  });
  for (const end of ['pointerup', 'pointercancel', 'lostpointercapture'])
    canvas.addEventListener(end, () => { held = null; });
  canvas.addEventListener('keydown', event => {
    const way = {ArrowLeft: [0.2, 0], ArrowRight: [-0.2, 0], ArrowUp: [0, -0.15], ArrowDown: [0, 0.15]}[event.key];
    if (way) move(...way);
    else if (event.key === 'Home') { view.yaw = view.pitch = 0; show(); }
    else return;
    event.preventDefault();
  });
  for (const button of root.querySelectorAll('[data-yaw]'))
    button.addEventListener('click', () => { view.yaw = +button.dataset.yaw; view.pitch = +button.dataset.pitch; show(); });
  for (const box of root.querySelectorAll('[data-look]')) {
    look[box.dataset.look] = box.checked;
    box.addEventListener('change', () => {
      look[box.dataset.look] = box.checked;
      if (box.dataset.look === 'wipe') slider.value = box.checked ? slider.max / 2 : 0;
      show();
    });
  }
  for (const control of [slider, ...ends]) control.addEventListener('input', show);
  canvas.addEventListener('webglcontextlost', () => { root.hidden = true; });
  root.hidden = false;
  new ResizeObserver(show).observe(canvas);
  draw();
  root.dataset.ready = 'yes';
})();
