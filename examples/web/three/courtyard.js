/** A scene of three.js with what is hard to upscale: wires, foliage, a moving shadow, a mirror, lettering, fine textures. */

import {
  AmbientLight, BoxGeometry, BufferAttribute, BufferGeometry, CanvasTexture, CatmullRomCurve3, Color, CylinderGeometry, DirectionalLight,
  DoubleSide, Group, InstancedMesh, LinearMipmapLinearFilter, Matrix4, Mesh, MeshBasicNodeMaterial, MeshStandardNodeMaterial, Object3D,
  PerspectiveCamera, PlaneGeometry, RepeatWrapping, Scene, SRGBColorSpace, TorusGeometry, TubeGeometry, Vector3,
} from "three/webgpu";
import { reflector } from "three/tsl";

const SHADOW_MAP = 1024, SHADOW_HALF_WIDTH = 5;

/** @param {number} aspect width / height @returns {{ scene: Scene, camera: PerspectiveCamera, animate: (time: number) => void }} */
export function makeCourtyard(aspect) {
  const scene = new Scene(), camera = new PerspectiveCamera(45, aspect, 0.1, 60);
  scene.background = new Color(0.35, 0.5, 0.75);
  const [wheel, tree] = [spokedWheel(), foliage()];
  wheel.position.set(-0.7, 1.25, -0.4);
  tree.position.set(2.2, 0, -1.4);
  scene.add(new AmbientLight(0xbfd4ff, 1), sun(), ...ground(), ...sign(), ...wires(), ...mirror(), wheel, tree);
  const animate = (time) => {
    wheel.rotation.z = -0.7 * time;
    tree.rotation.z = 0.03 * Math.sin(1.7 * time);
    camera.position.set(0.9 * Math.sin(0.5 * time), 1.5 + 0.1 * Math.sin(0.7 * time), 4.2);
    camera.lookAt(0, 1.25, -1);
  };
  return { scene, camera, animate };
}

function sun() {
  const light = new DirectionalLight(0xfff0d8, 3);
  light.position.set(-2.5, 5, 3.5);
  light.castShadow = true;
  light.shadow.mapSize.set(SHADOW_MAP, SHADOW_MAP);
  Object.assign(light.shadow.camera, { left: -SHADOW_HALF_WIDTH, right: SHADOW_HALF_WIDTH, top: SHADOW_HALF_WIDTH, bottom: -SHADOW_HALF_WIDTH, far: 15 });
  light.shadow.bias = -0.002;
  return light;
}

/** @param {[number, number]} size @param {(context: OffscreenCanvasRenderingContext2D, size: [number, number]) => void} draw */
function drawnTexture([width, height], draw) {
  const canvas = new OffscreenCanvas(width, height);
  draw(canvas.getContext("2d"), [width, height]);
  return Object.assign(new CanvasTexture(canvas), {
    colorSpace: SRGBColorSpace, wrapS: RepeatWrapping, wrapT: RepeatWrapping, generateMipmaps: true, minFilter: LinearMipmapLinearFilter, anisotropy: 8,
  });
}

function ground() {
  const tiles = drawnTexture([256, 256], (context, [width]) => {
    for (const [x, y, shade] of [[0, 0, "#d0c8b8"], [1, 0, "#5f5a55"], [0, 1, "#5f5a55"], [1, 1, "#d0c8b8"]]) {
      context.fillStyle = shade;
      context.fillRect((x * width) / 2, (y * width) / 2, width / 2, width / 2);
    }
  });
  tiles.repeat.set(24, 24);
  const bricks = drawnTexture([256, 256], (context, [width, height]) => {
    context.fillStyle = "#b8b0a4";
    context.fillRect(0, 0, width, height);
    for (let row = 0; row < 8; row++) {
      for (let column = -1; column < 4; column++) {
        context.fillStyle = `hsl(12 ${40 + ((7 * row + 5 * column) % 4) * 5}% ${34 + ((3 * row + 11 * column) % 5) * 3}%)`;
        context.fillRect(column * 64 + (row % 2) * 32 + 3, row * 32 + 3, 58, 26);
      }
    }
  });
  bricks.repeat.set(5, 2.5);
  const floor = new Mesh(new PlaneGeometry(24, 24), new MeshStandardNodeMaterial({ map: tiles, roughness: 0.9 }));
  floor.rotation.x = -Math.PI / 2;
  const wall = new Mesh(new PlaneGeometry(8, 2.2), new MeshStandardNodeMaterial({ map: bricks, roughness: 0.95 }));
  wall.position.set(0, 1.1, -2.5);
  floor.receiveShadow = wall.receiveShadow = true;
  return [floor, wall];
}

function sign() {
  const lettering = drawnTexture([1024, 512], (context, [width, height]) => {
    context.fillStyle = "#f4efe2";
    context.fillRect(0, 0, width, height);
    context.fillStyle = "#1c2333";
    ["Temporal supersampling", "adds up the samples of many", "frames, each at another place", "of the pixel. 0123456789"].forEach((line, i) => {
      context.font = `${[84, 66, 50, 38][i]}px sans-serif`;
      context.fillText(line, 40, 110 + 108 * i, width - 80);
    });
  });
  const board = new Mesh(new PlaneGeometry(1.7, 0.85), new MeshStandardNodeMaterial({ map: lettering, roughness: 0.8 }));
  board.position.set(0.55, 1.45, -2.45);
  board.receiveShadow = true;
  return [board];
}

/** Cables against the sky, and a fence of thin wires. */
function wires() {
  const material = new MeshStandardNodeMaterial({ color: 0x16181c, roughness: 0.6 });
  const cables = [0, 1, 2, 3].map((i) => {
    const ends = [[-4.5, 3.1 + 0.16 * i, -3 - 0.3 * i], [0, 2.5 + 0.15 * i, -3], [4.5, 3.0 + 0.17 * i, -3]].map((place) => new Vector3(...place));
    return new Mesh(new TubeGeometry(new CatmullRomCurve3(ends), 80, 0.006, 5), material);
  });
  const count = 56, fence = new InstancedMesh(new CylinderGeometry(0.005, 0.005, 1.5, 5), new MeshStandardNodeMaterial({ color: 0xd8dde2, metalness: 0.4, roughness: 0.4 }), count);
  for (let i = 0; i < count; i++) {
    const place = new Matrix4().makeRotationZ(i % 2 ? 0.75 : -0.75);
    fence.setMatrixAt(i, place.setPosition(1.2 + 0.1 * (i >> 1), 0.55, 0.2 + 0.01 * (i % 2)));
  }
  fence.frustumCulled = false;
  return [...cables, fence];
}

function mirror() {
  const reflection = reflector(), glass = new Mesh(new PlaneGeometry(1.3, 1.5), new MeshBasicNodeMaterial());
  glass.material.colorNode = reflection.mul(0.9);
  const frame = new Mesh(new BoxGeometry(1.4, 1.6, 0.05), new MeshStandardNodeMaterial({ color: 0x5a3a22 })), whole = new Group();
  glass.position.z = 0.03;
  reflection.target.position.z = 0.03;
  whole.add(frame, glass, reflection.target);
  whole.position.set(-2.2, 1.0, -1.9);
  whole.rotation.y = 0.45;
  return [whole];
}

function spokedWheel() {
  const material = new MeshStandardNodeMaterial({ color: 0xb03a22, roughness: 0.5 }), wheel = new Mesh(new TorusGeometry(0.7, 0.025, 8, 64), material);
  for (let i = 0; i < 9; i++) {
    const spoke = new Mesh(new BoxGeometry(1.4, 0.012, 0.012), material);
    spoke.rotation.z = (Math.PI * i) / 9;
    wheel.add(spoke);
  }
  wheel.traverse((part) => {
    part.castShadow = true;
  });
  return wheel;
}

/** A trunk with leaves, each two triangles. */
function foliage() {
  const leaf = new BufferGeometry(), corners = [0, 0, 0, 0.04, 0.06, 0.01, 0, 0.15, 0, -0.04, 0.06, 0.01];
  leaf.setAttribute("position", new BufferAttribute(new Float32Array(corners), 3));
  leaf.setIndex([0, 1, 2, 0, 2, 3]);
  leaf.computeVertexNormals();
  const count = 700, leaves = new InstancedMesh(leaf, new MeshStandardNodeMaterial({ color: 0xffffff, roughness: 0.7, side: DoubleSide }), count);
  const random = randomNumbers(3), place = new Object3D();
  for (let i = 0; i < count; i++) {
    const [turn, height, radius] = [2 * Math.PI * random(), random(), Math.sqrt(random())], wide = 0.75 * Math.sin(Math.PI * (0.15 + 0.8 * height));
    place.position.set(wide * radius * Math.cos(turn), 1.0 + 1.4 * height, wide * radius * Math.sin(turn));
    place.rotation.set(3 * random(), 6 * random(), 3 * random());
    place.updateMatrix();
    leaves.setMatrixAt(i, place.matrix);
    leaves.setColorAt(i, new Color().setHSL(0.24 + 0.08 * random(), 0.55, 0.16 + 0.2 * random()));
  }
  leaves.frustumCulled = false;
  const trunk = new Mesh(new CylinderGeometry(0.05, 0.09, 1.5, 9), new MeshStandardNodeMaterial({ color: 0x4a3524 })), tree = new Group();
  trunk.position.y = 0.75;
  leaves.castShadow = trunk.castShadow = true;
  tree.add(trunk, leaves);
  return tree;
}

/** @param {number} seed @returns {() => number} in [0, 1), the same in each run */
function randomNumbers(seed) {
  let state = seed;
  return () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  };
}
