/** A scene of three.js with what aliases: a lattice, spokes, a net of wires, a checked floor. */

import {
  BoxGeometry, Color, CylinderGeometry, DataTexture, DirectionalLight, Fog, HemisphereLight, InstancedMesh, LinearMipmapLinearFilter,
  LinearFilter, Matrix4, Mesh, MeshBasicNodeMaterial, MeshStandardNodeMaterial, PerspectiveCamera, PlaneGeometry, PointLight,
  RepeatWrapping, Scene, SphereGeometry, SRGBColorSpace, TorusGeometry, TorusKnotGeometry,
} from "three/webgpu";
import { float, texture } from "three/tsl";

const CHECKS = 64;

/** @param {number} aspect width / height @param {number} ratio display over render size @returns {{ scene: Scene, camera: PerspectiveCamera, animate: (time: number) => void }} */
export function makeYard(aspect, ratio) {
  const scene = new Scene(), camera = new PerspectiveCamera(45, aspect, 0.1, 60);
  scene.background = new Color(0.35, 0.5, 0.75);
  scene.fog = new Fog(scene.background, 15, 50);
  scene.add(new HemisphereLight(0xbfd4ff, 0x6b5b45, 1.2));
  const sun = new DirectionalLight(0xfff0d8, 2.5);
  sun.position.set(3, 5, 2);
  scene.add(sun, floor(ratio), lattice());

  const knot = new Mesh(new TorusKnotGeometry(0.6, 0.16, 160, 16), new MeshStandardNodeMaterial({ color: 0xd9a441, metalness: 0.3, roughness: 0.35 }));
  knot.position.set(-0.4, 1.2, -1);
  const wheel = spokedWheel();
  wheel.position.set(-2.6, 1.2, -1.6);
  const lamp = new Mesh(new SphereGeometry(0.1), new MeshBasicNodeMaterial({ color: new Color(12, 5, 2) }));
  lamp.add(new PointLight(0xff8844, 12));
  scene.add(knot, wheel, lamp);

  const animate = (time) => {
    knot.rotation.set(0.4, 0.8 * time, 0);
    wheel.rotation.z = -0.7 * time;
    lamp.position.set(1.8 * Math.sin(time), 0.8, -1 + 1.4 * Math.cos(time));
    camera.position.set(1.6 * Math.sin(0.4 * time), 1.6 + 0.2 * Math.sin(0.5 * time), 4.6);
    camera.lookAt(0, 1.1, -1);
  };
  return { scene, camera, animate };
}

function floor(ratio) {
  const pixels = new Uint8Array(4 * CHECKS * CHECKS).map((_, i) => {
    const pixel = i >> 2, isDark = ((pixel % CHECKS < CHECKS / 2) !== (pixel / CHECKS < CHECKS / 2));
    return i % 4 === 3 ? 255 : isDark ? 90 : 190;
  });
  const map = new DataTexture(pixels, CHECKS, CHECKS);
  Object.assign(map, {
    wrapS: RepeatWrapping, wrapT: RepeatWrapping, colorSpace: SRGBColorSpace, generateMipmaps: true,
    minFilter: LinearMipmapLinearFilter, magFilter: LinearFilter, anisotropy: 8, needsUpdate: true,
  });
  map.repeat.set(40, 40);
  const material = new MeshStandardNodeMaterial({ roughness: 0.9 });
  material.colorNode = texture(map).bias(float(-Math.log2(ratio))); // as sharp as at display size
  const mesh = new Mesh(new PlaneGeometry(60, 60), material);
  mesh.rotation.x = -Math.PI / 2;
  return mesh;
}

function lattice() {
  const count = 44, bars = new InstancedMesh(new CylinderGeometry(0.008, 0.008, 2.6, 5), new MeshStandardNodeMaterial({ color: 0x9aa4ad }), count);
  for (let i = 0; i < count; i++) {
    const lean = i % 2 ? 0.7 : -0.7, place = new Matrix4().makeRotationZ(lean);
    place.setPosition(0.9 + 0.13 * (i >> 1), 1, -0.6 + 0.01 * (i % 2));
    bars.setMatrixAt(i, place);
  }
  bars.frustumCulled = false;
  return bars;
}

function spokedWheel() {
  const material = new MeshStandardNodeMaterial({ color: 0xb03a22, roughness: 0.5 });
  const wheel = new Mesh(new TorusGeometry(1, 0.03, 8, 64), material);
  for (let i = 0; i < 12; i++) {
    const spoke = new Mesh(new BoxGeometry(2, 0.014, 0.014), material);
    spoke.rotation.z = (Math.PI * i) / 12;
    wheel.add(spoke);
  }
  return wheel;
}
