// The machine in space: its parts moved by its axes, the program's path done and to come, and where the tips went.
// Everything is in mm. Drawn only when something has changed: a phone's battery is an operator's, too.
import { THREE, OrbitControls } from "nicegui-scene";

const TRAIL_POINTS = 6000;
const PICK_PIXELS = 8;
const REACH_POINTS = 3000;
const ON_LIGHT = { come: 0x475569, done: 0x1d4ed8, trail: 0xf97316, tip: 0xdc2626, reach: 0x0f766e };
const ON_DARK = { come: 0x94a3b8, done: 0x60a5fa, trail: 0xf97316, tip: 0xef4444, reach: 0x2dd4bf };
const colours = () => (document.body.classList.contains("body--dark") ? ON_DARK : ON_LIGHT);

const decode = (text, Kind) => {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Kind(bytes.buffer);
};

const polyline = (kind, count) => {
  const colour = colours()[kind];
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(3 * count), 3));
  geometry.setDrawRange(0, 0);
  const line = new THREE.Line(geometry, new THREE.LineBasicMaterial({ color: colour }));
  line.frustumCulled = false;
  // browsers draw lines one pixel wide, whatever is asked for: points on top make them wider
  const points = new THREE.Points(geometry, new THREE.PointsMaterial({ color: colour, size: 2.5 * Math.min(window.devicePixelRatio, 2), sizeAttenuation: false }));
  points.frustumCulled = false;
  line.add(points);
  line.userData.kind = kind;
  return line;
};

const marked = (name) => {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [256, 64];
  const paint = canvas.getContext("2d");
  paint.font = "bold 40px sans-serif";
  paint.fillStyle = "#aa3377";
  paint.fillText(name, 4, 46);
  const material = new THREE.SpriteMaterial({ map: new THREE.CanvasTexture(canvas), depthTest: false });
  const label = new THREE.Sprite(material);
  label.scale.set(4, 1, 1);
  label.center.set(0, 0);
  return new THREE.Group().add(new THREE.AxesHelper(1), label);
};

// of a point from a straight line between two others
const distance = (at, from, to) => {
  const along = to.clone().sub(from);
  const share = along.lengthSq() ? THREE.MathUtils.clamp(at.clone().sub(from).dot(along) / along.lengthSq(), 0, 1) : 0;
  return at.distanceTo(from.clone().addScaledVector(along, share));
};

export default {
  template: `<div class="mc-space" style="position:relative;overflow:hidden">
    <canvas tabindex="0" role="img" :aria-label="label" style="display:block;width:100%;height:100%"></canvas></div>`,
  props: { label: String, modelUrl: String },

  mounted() {
    // plain fields: Vue must not watch what three.js changes
    this.trails = new Map();
    this.tips = new Map();
    this.planned = [];
    this.marks = [];
    this.jointFrames = [];
    this.axisParts = new Map();
    this.links = new Map();
    [this.bases, this.ends] = [{}, {}];
    this.reached = [];
    this.holders = new Map();
    this.toolBodies = [];
    this.zones = [];
    this.bodies = { tools: [], inputs: {} };
    this.line = 0;
    this.moved = false;
    this.fresh = true;
    this.scene = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(40, 1, 1, 1e6);
    this.camera.up.set(0, 0, 1);
    this.camera.position.set(1, -1.6, 1.1);
    this.scene.add(new THREE.HemisphereLight(0xffffff, 0x64748b, 2.2));
    const sun = new THREE.DirectionalLight(0xffffff, 1.6);
    sun.position.set(0.6, -1, 1.5);
    this.scene.add(sun);
    this.content = new THREE.Group();
    this.body = new THREE.Group();
    // zones may be far larger than the machine: nobody looks at all of them
    this.zoneBoxes = new THREE.Group();
    // turned so that the machine's up is the picture's
    this.world = new THREE.Group();
    this.world.add(this.content, this.body, this.zoneBoxes);
    this.scene.add(this.world);
    const canvas = this.$el.querySelector("canvas");
    try {
      this.renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true, canvas });
    } catch {
      this.$el.textContent = window.mcTexts["This browser draws no 3-D pictures (WebGL)."];
      return;
    }
    // a browser takes a context away when it is short of memory, or its graphics process has ended: what it gives
    // back is empty until something is drawn
    canvas.addEventListener("webglcontextrestored", () => this.draw());
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.addEventListener("change", () => this.draw());
    this.controls.addEventListener("start", () => (this.moved = true));
    canvas.addEventListener("pointerdown", (event) => (this.pressed = [event.clientX, event.clientY]));
    canvas.addEventListener("pointerup", (event) => this.pick(event, canvas));
    this.sized = new ResizeObserver(() => this.resize());
    this.sized.observe(this.$el);
    this.resize();
    if (this.modelUrl) this.loadModel(this.modelUrl);
    const ready = setInterval(() => {
      if (window.socket?.id === undefined) return;
      clearInterval(ready);
      this.$emit("ready");
    }, 50);
  },

  beforeUnmount() {
    this.sized?.disconnect();
    this.controls?.dispose();
    this.renderer?.dispose();
    this.gone = true;
  },

  methods: {
    resize() {
      const width = this.$el.clientWidth, height = this.$el.clientHeight;
      if (!width || !height || !this.renderer) return;
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / height;
      this.camera.updateProjectionMatrix();
      // what filled a wide picture is cut off in a narrow one
      if (!this.moved && !this.fresh) this.fit();
      this.draw();
    },

    draw() {
      if (this.waiting || this.gone || !this.renderer) return;
      this.waiting = true;
      requestAnimationFrame(() => {
        this.waiting = false;
        if (this.worn !== colours()) this.recolour();
        if (!this.gone) this.renderer.render(this.scene, this.camera);
      });
    },

    // light and dark change while the picture is there
    recolour() {
      this.worn = colours();
      this.content.traverse((part) => {
        const kind = part.userData.kind ?? part.parent?.userData.kind;
        if (kind) part.material.color.setHex(this.worn[kind]);
      });
    },

    async loadModel(url) {
      let model;
      try {
        const answer = await fetch(url);
        if (!answer.ok) return;
        model = await answer.json();
      } catch { return; }
      if (this.gone) return;
      this.body.clear();
      this.zoneBoxes.clear();
      this.axisParts.clear();
      [this.toolBodies, this.zones] = [[], []];
      const groups = new Map();
      this.links = groups;
      [this.bases, this.ends] = [model.bases ?? {}, model.ends ?? {}];
      for (const part of model.parts) {
        const group = new THREE.Group();
        if (part.pose) new THREE.Matrix4().fromArray(part.pose).transpose().decompose(group.position, group.quaternion, group.scale);
        group.userData.base = { position: group.position.clone(), quaternion: group.quaternion.clone() };
        for (const solid of part.solids) {
          const geometry = new THREE.BufferGeometry();
          geometry.setAttribute("position", new THREE.BufferAttribute(decode(solid.vertices, Float32Array), 3));
          geometry.setIndex(new THREE.BufferAttribute(decode(solid.faces, Uint32Array), 1));
          geometry.computeVertexNormals();
          const [red, green, blue] = solid.colour;
          const material = new THREE.MeshLambertMaterial({ color: `rgb(${red},${green},${blue})`, side: THREE.DoubleSide });
          if (part.zone) {
            Object.assign(material, { transparent: true, opacity: 0.2, depthWrite: false });
            const edges = new THREE.LineSegments(new THREE.EdgesGeometry(geometry), new THREE.LineBasicMaterial({ color: material.color }));
            group.add(edges);
          }
          group.add(new THREE.Mesh(geometry, material));
        }
        if (part.cutter) {
          const turned = new THREE.CylinderGeometry(0.5, 0.5, 1, 48).rotateX(Math.PI / 2).translate(0, 0, -0.5);
          group.add(new THREE.Mesh(turned, new THREE.MeshLambertMaterial({ color: 0x969ca5 })));
        }
        if (part.zone) this.zones.push({ group, input: part.input, high: part.high });
        if (part.cutter || part.tool) this.toolBodies.push({ group, ...part });
        (groups.get(part.parent) ?? (part.zone ? this.zoneBoxes : this.body)).add(group);
        groups.set(part.name, group);
        if (part.driver !== null) {
          const parts = this.axisParts.get(part.driver) ?? [];
          parts.push({ group, kind: part.kind, axis: new THREE.Vector3(...part.axis), ratio: part.ratio, offset: part.offset });
          this.axisParts.set(part.driver, parts);
        }
      }
      this.world.quaternion.setFromUnitVectors(new THREE.Vector3(...model.up), new THREE.Vector3(0, 0, 1));
      this.carry();
      this.showBodies(this.bodies);
      if (this.last) this.place(this.last);
      this.frames(this.framesShown);
      this.reach(this.reachShown);
      this.fit();
    },

    // bodies: {tools: [{number, spindle, length, diameter}], inputs: {name: whether it is high}}
    showBodies(bodies) {
      this.bodies = bodies;
      for (const { group, tool, cutter } of this.toolBodies) {
        const mounted = bodies.tools.find((each) => (cutter ? each.spindle && each.length > 0 : each.number === tool));
        group.visible = Boolean(mounted);
        if (cutter && mounted) group.scale.set(mounted.diameter, mounted.diameter, mounted.length);
      }
      // switched off: its edges alone
      for (const { group, input, high } of this.zones) {
        for (const part of group.children) if (part.isMesh) part.visible = (bodies.inputs[input] ?? high) === high;
      }
      this.draw();
    },

    // the frame of each part that an axis moves
    frames(shown) {
      this.framesShown = shown;
      for (const frame of this.jointFrames) frame.removeFromParent();
      const size = new THREE.Box3().setFromObject(this.body).getSize(new THREE.Vector3()).length();
      const moved = shown ? [...this.axisParts.values()].flat() : [];
      this.jointFrames = moved.map(({ group }) => new THREE.AxesHelper(0.08 * size));
      moved.forEach(({ group }, index) => group.add(this.jointFrames[index]));
      this.draw();
    },

    // spans: {label: {axis: [least, greatest]}}: marks places of each tip with its axes somewhere in their travel
    reach(spans) {
      this.reachShown = spans;
      for (const cloud of this.reached) cloud.removeFromParent();
      this.reached = [];
      for (const [label, travel] of Object.entries(spans ?? {})) {
        const tip = this.links.get(this.ends[label]), base = this.links.get(this.bases[label]) ?? this.world;
        if (!tip) continue;
        const at = new THREE.Vector3(), places = new Float32Array(3 * REACH_POINTS);
        // the same places each time: Park and Miller's generator
        let seed = 1;
        const random = () => (seed = (48271 * seed) % 2147483647) / 2147483647;
        for (let index = 0; index < REACH_POINTS; index += 1) {
          for (const [axis, [least, greatest]] of Object.entries(travel)) this.move(axis, least + random() * (greatest - least));
          for (const part of [base, tip]) part.updateWorldMatrix(true, false);
          base.worldToLocal(at.setFromMatrixPosition(tip.matrixWorld)).toArray(places, 3 * index);
        }
        const geometry = new THREE.BufferGeometry();
        geometry.setAttribute("position", new THREE.BufferAttribute(places, 3));
        const cloud = new THREE.Points(geometry, new THREE.PointsMaterial({ color: colours().reach, size: 2, sizeAttenuation: false }));
        cloud.userData.kind = "reach";
        this.holder(label).add(cloud);
        this.reached.push(cloud);
      }
      if (this.last) this.place(this.last);
      if (!this.moved) this.fit();
      this.draw();
    },

    // places: {name: [x, y, z]}
    zeros(places) {
      this.content.remove(...this.marks);
      this.marks = Object.entries(places).map(([name, at]) => {
        const mark = marked(name);
        mark.position.set(...at);
        mark.scale.setScalar(0.03 * (this.size ?? 100));
        return mark;
      });
      if (this.marks.length) this.content.add(...this.marks);
      if (!this.moved) this.fit();
      this.draw();
    },

    // state: {axes: {number: mm | deg}, tips: {label: [x, y, z]}, line, trail: {label: [[x, y, z], …]}, restart}
    place(state) {
      this.last = { ...state, trail: {}, restart: false };
      for (const [axis, value] of Object.entries(state.axes ?? {})) this.move(axis, value);
      this.carry();
      if (state.restart) for (const trail of this.trails.values()) { trail.points = []; this.fill(trail.line, []); }
      for (const [label, points] of Object.entries(state.trail ?? {})) {
        const trail = this.trails.get(label) ?? this.newTrail(label);
        trail.points.push(...points);
        if (trail.points.length > TRAIL_POINTS) trail.points.splice(0, trail.points.length - TRAIL_POINTS + TRAIL_POINTS / 4);
        this.fill(trail.line, trail.points);
      }
      for (const [label, at] of Object.entries(state.tips ?? {})) {
        const tip = this.tips.get(label) ?? this.newTip(label);
        tip.position.set(...at);
      }
      if (state.line !== undefined) { this.line = state.line; this.advance(state.tips ?? {}); }
      this.follow(state.tips ?? {});
      this.draw();
    },

    // the parts that an axis moves, to where it is at a value [mm, deg]
    move(axis, value) {
      for (const part of this.axisParts.get(Number(axis)) ?? []) {
        const { group } = part, base = group.userData.base;
        if (part.kind === "prismatic") {
          const shift = part.axis.clone().multiplyScalar(part.ratio * value + part.offset);
          group.position.copy(base.position).add(shift.applyQuaternion(base.quaternion));
        } else {
          const turn = new THREE.Quaternion().setFromAxisAngle(part.axis, (part.ratio * value + part.offset) * Math.PI / 180);
          group.quaternion.copy(base.quaternion).multiply(turn);
        }
      }
    },

    // what the coordinates of a tip are relative to: the link that carries its work, or the machine's base
    holder(label) {
      let holder = this.holders.get(label);
      if (!holder) {
        holder = new THREE.Group();
        holder.matrixAutoUpdate = false;
        this.holders.set(label, holder);
        this.content.add(holder);
        this.carry();
      }
      return holder;
    },

    // take tips and paths along with the links that carry their work
    carry() {
      this.world.updateMatrixWorld(true);
      for (const [label, holder] of this.holders) {
        const link = this.links.get(this.bases[label]);
        holder.matrix.copy(this.world.matrixWorld).invert().multiply((link ?? this.world).matrixWorld);
      }
      this.world.updateMatrixWorld(true);
    },

    newTrail(label) {
      const trail = { points: [], line: polyline("trail", TRAIL_POINTS + 64) };
      this.trails.set(label, trail);
      this.holder(label).add(trail.line);
      return trail;
    },

    newTip(label) {
      const tip = new THREE.Mesh(new THREE.SphereGeometry(1, 16, 12), new THREE.MeshLambertMaterial({ color: colours().tip }));
      this.tips.set(label, tip);
      this.holder(label).add(tip);
      return tip;
    },

    fill(line, points) {
      const attribute = line.geometry.getAttribute("position");
      const count = Math.min(points.length, attribute.count);
      for (let index = 0; index < count; index += 1) attribute.setXYZ(index, ...points[points.length - count + index]);
      attribute.needsUpdate = true;
      line.geometry.setDrawRange(0, count);
    },

    // path: {lines: [n], tips: [{tool, points}]}, or null
    plan(path) {
      for (const { come, done, now } of this.planned) for (const line of [come, done, now]) line.removeFromParent();
      this.planned = [];
      for (const { tool, points } of path?.tips ?? []) {
        const come = polyline("come", points.length), done = polyline("done", points.length);
        this.fill(come, points);
        const now = polyline("trail", 0);
        for (const line of [done, now]) line.geometry.setAttribute("position", come.geometry.getAttribute("position"));
        // in sight wherever another lap of the path, or the machine, lies in front of it
        now.traverse((part) => { part.renderOrder = 1; part.material.depthTest = false; });
        const label = tool === null ? "" : `T${tool}`;
        this.holder(label).add(come, done, now);
        this.planned.push({ label, points, lines: path.lines, come, done, now, at: 0 });
      }
      this.moved = false;
      this.fit();
    },

    // the path is done up to the point of the line under way that is nearest to the tip; it never goes back
    advance(tips) {
      for (const each of this.planned) {
        const tip = tips[each.label];
        if (this.line > 0 && tip) {
          let best = -1, nearest = Infinity;
          for (let index = each.at; index < each.points.length && each.lines[index] <= this.line; index += 1) {
            if (each.lines[index] < this.line) { best = index; continue; }
            const [x, y, z] = each.points[index];
            const far = (x - tip[0]) ** 2 + (y - tip[1]) ** 2 + (z - tip[2]) ** 2;
            if (far <= nearest) { nearest = far; best = index; }
          }
          each.at = Math.max(each.at, best);
        }
        each.done.geometry.setDrawRange(0, each.at + 1);
        each.come.geometry.setDrawRange(each.at, each.points.length - each.at);
      }
    },

    bounds() {
      const box = new THREE.Box3();
      if (this.body.children.length) box.expandByObject(this.body);
      for (const cloud of this.reached) box.expandByObject(cloud);
      const paths = [...this.trails].map(([label, { points }]) => ({ label, points }));
      for (const { label, points } of [...paths, ...this.planned]) {
        for (const point of points) box.expandByPoint(this.inWorld(point, label));
      }
      for (const [label, { position }] of this.tips) box.expandByPoint(this.inWorld(position.toArray(), label));
      for (const { position } of this.marks) box.expandByPoint(this.inWorld(position.toArray(), ""));
      return box;
    },

    // span: [first, last] row of the line under way, or null
    showRow(state, row, span) {
      this.place(state);
      for (const each of this.planned) {
        each.now.geometry.setDrawRange(span ? span[0] : 0, span ? span[1] - span[0] + 1 : 0);
        each.done.geometry.setDrawRange(0, row + 1);
        each.come.geometry.setDrawRange(row, each.points.length - row);
      }
    },

    // the part of a path that a line drives; where it has no point of its own, the end of the line before it
    mark(line) {
      for (const each of this.planned) {
        const { lines } = each, drives = lines.includes(line);
        const last = drives ? lines.lastIndexOf(line) : lines.findLastIndex((other) => other > 0 && other < line);
        const from = drives ? Math.max(lines.indexOf(line) - 1, 0) : last;
        each.now.geometry.setDrawRange(Math.max(from, 0), last < 0 ? 0 : last - from + 1);
      }
      this.draw();
    },

    // a click that turned nothing, near a path: the line that drives there
    pick(event, canvas) {
      const [x, y] = this.pressed ?? [NaN, NaN];
      if (!(Math.hypot(event.clientX - x, event.clientY - y) <= PICK_PIXELS)) return;
      const box = canvas.getBoundingClientRect();
      const at = new THREE.Vector2(event.clientX - box.left, event.clientY - box.top);
      let nearest = PICK_PIXELS, picked = 0;
      for (const { label, points, lines } of this.planned) {
        let before = null;
        points.forEach((point, index) => {
          const { x, y, z } = this.inWorld(point, label).project(this.camera);
          // behind the camera there is nothing to click on
          const here = z > 1 ? null : new THREE.Vector2((x + 1) * box.width / 2, (1 - y) * box.height / 2);
          const far = here === null ? Infinity : distance(at, before ?? here, here);
          before = here;
          if (far < nearest) { nearest = far; picked = lines[index]; }
        });
      }
      if (picked) this.$emit("picked", picked);
    },

    inWorld(point, label) { return new THREE.Vector3(...point).applyMatrix4(this.holder(label).matrixWorld); },

    // what is drawn may outgrow the view while it moves: look at all of it again, unless somebody has turned the view
    follow(tips) {
      if (this.moved) return;
      const outside = !this.fresh && Object.entries(tips).some(([label, at]) => !this.box.containsPoint(this.inWorld(at, label)));
      if (outside || this.fresh) this.fit();
    },

    fit() {
      const box = this.bounds();
      if (box.isEmpty()) { this.fresh = true; return; }
      this.fresh = false;
      const size = Math.max(box.getSize(new THREE.Vector3()).length(), 10);
      this.size = size;
      const middle = box.getCenter(new THREE.Vector3());
      this.box = box.clone().expandByScalar(0.06 * size);
      const away = this.camera.position.clone().sub(this.controls.target);
      if (away.length() === 0) away.set(1, -1.6, 1.1);
      away.setLength(1.06 * this.distanceTo(box, middle, away, size));
      this.controls.target.copy(middle);
      this.camera.position.copy(middle).add(away);
      this.camera.near = away.length() / 200;
      this.camera.far = away.length() * 50;
      this.camera.updateProjectionMatrix();
      for (const tip of this.tips.values()) tip.scale.setScalar(0.008 * size);
      for (const mark of this.marks) mark.scale.setScalar(0.03 * size);
      this.ground(box, size);
      this.controls.update();
      this.draw();
    },

    // from how far all of a box is in view: each corner within both angles of the picture
    distanceTo(box, middle, away, size) {
      const back = away.clone().normalize();
      const right = new THREE.Vector3().crossVectors(this.camera.up, back).normalize();
      const above = new THREE.Vector3().crossVectors(back, right);
      const high = Math.tan(this.camera.fov * Math.PI / 360), wide = high * this.camera.aspect;
      let far = 0.5 * size;
      for (const x of [box.min.x, box.max.x]) for (const y of [box.min.y, box.max.y]) for (const z of [box.min.z, box.max.z]) {
        const corner = new THREE.Vector3(x, y, z).sub(middle);
        far = Math.max(far, corner.dot(back) + Math.max(Math.abs(corner.dot(right)) / wide, Math.abs(corner.dot(above)) / high));
      }
      return far;
    },

    lookAtAll() { this.moved = false; this.fit(); },

    // a grid below everything, its squares 1, 2 or 5 times a power of ten [mm]
    ground(box, size) {
      const raw = size / 14, power = 10 ** Math.floor(Math.log10(raw));
      const step = [1, 2, 5, 10].find((each) => each * power >= raw) * power;
      const middle = box.getCenter(new THREE.Vector3());
      const key = [step, box.min.z, Math.round(middle.x / step), Math.round(middle.y / step)].join();
      if (key === this.groundKey) return;
      this.groundKey = key;
      if (this.grid) this.scene.remove(this.grid, this.frame);
      this.grid = new THREE.GridHelper(20 * step, 20, 0x64748b, 0x64748b);
      this.grid.material.transparent = true;
      this.grid.material.opacity = 0.22;
      this.grid.rotateX(Math.PI / 2);
      this.grid.position.set(Math.round(middle.x / step) * step, Math.round(middle.y / step) * step, box.min.z);
      this.frame = new THREE.AxesHelper(2 * step);
      this.scene.add(this.grid, this.frame);
    },
  },
};
