/**
 * Temporal supersampling as a node of three.js' render pipeline, with the arguments of its TAAU node:
 *
 *   import { supersampler } from "supersampler/three";
 *
 *   const scenePass = pass(scene, camera).setMRT(mrt({ output, velocity })).setResolutionScale(0.5);
 *   const [beauty, depth, motion] = ["output", "depth", "velocity"].map((name) => scenePass.getTextureNode(name));
 *   renderPipeline.outputNode = supersampler(beauty, depth, motion, camera);
 *
 * The shaders run on the device of a WebGPURenderer. Without WebGPU the node reports why, and is three.js' TAAU.
 */

import {
  FloatType, HalfFloatType, Matrix4, NoBlending, Node, NodeMaterial, NodeUpdateType, QuadMesh, RGFormat, RedFormat, RenderTarget,
  RendererUtils, StorageTexture, Vector2,
} from "three/webgpu";
import {
  OnAfterRenderPipeline, OnBeforeRenderPipeline, context, convertToTexture, dFdx, dFdy, ivec2, logarithmicDepthToViewZ,
  orthographicDepthToViewZ, outputStruct, passTexture, perspectiveDepthToViewZ, screenCoordinate, uniform, vec2, vec4, velocity,
} from "three/tsl";
import { taau } from "three/addons/tsl/display/TAAUNode.js";
import { haltonJitter } from "../jitter.js";
import models from "../models/index.js";
import { Upscaler, UpscalerError } from "../supersampler.js";
import { shown } from "../supersampler_folder.js";

const ANTIALIAS = "Make the renderer with antialias: false, and the pass without samples.";
const PIPELINES = "Make a render pipeline for each view.";
const SCALES = "Give both passes the same resolution scale.";
const TEXTURE_NODE = "`getTextureNode(name)` of a pass returns one.";
const VELOCITY = "Draw it: pass(scene, camera).setMRT(mrt({ output, velocity })).";

/**
 * Makes textures of a pass as sharp as at display size: their gradients are those of display pixels.
 * @param {import("three/webgpu").Node} detail render size / display size @param {?import("three/webgpu").ContextNode} [other] the pass's own context
 * @returns {import("three/webgpu").ContextNode} for `contextNode` of the pass
 */
export const sharpTextures = (detail, other = null) => context(other, {
  getTextureGradient: (node, { shaderStage }) => {
    if (shaderStage !== "fragment" || node.value.isCubeTexture || node.value.is3DTexture) return null; // a displacement has no gradients
    const uv = node.getDefaultUV();
    return [dFdx(uv), dFdy(uv)].map((gradient) => gradient.mul(detail));
  },
});

/** The upscaled image of a pass, at the size of the renderer's drawing buffer. */
export class SupersamplerNode extends Node {
  static get type() {
    return "SupersamplerNode";
  }

  /** Use `supersampler`. */
  constructor(beautyNode, depthNode, velocityNode, camera, { method = "classifier" } = {}) {
    super("vec4");
    if (!Object.hasOwn(models, method)) throw new UpscalerError("method", JSON.stringify(method), Object.keys(models).join(" or "));
    this.updateBeforeType = NodeUpdateType.FRAME;
    this.beautyNode = beautyNode;
    this.depthNode = depthNode;
    this.velocityNode = velocityNode;
    this.camera = camera;
    this.method = method;
    /** Resolves when images are upscaled, or when three.js' TAAU has taken over. Until then the pass is shown as it is. */
    this.ready = new Promise((resolve) => {
      this._resolveReady = resolve;
    });
    this._upscaler = null;
    this._fallback = null;
    this._isReset = true;
    this._frame = 0;
    this._jitter = null; // of this frame; null before the upscaler is ready
    this._renderSize = [1, 1]; // that this frame is jittered for
    this._mismatches = 0; // frames one after another whose textures differ in size
    this._projection = new Matrix4(); // without jitter
    this._clip = new Matrix4(); // world to clip coordinates, of this frame and the previous one
    this._previousClip = new Matrix4();
    this._uniforms = {
      planes: uniform(new Vector2()), // near and far
      distances: uniform(new Vector2()), // the frame's depth is x / (y + view distance)
      jitter: uniform(new Vector2()), size: uniform(new Vector2()), toPrevious: uniform(new Matrix4()),
      detail: uniform(1), // render size / display size
    };
    this._contexts = new Map(); // of the passes: their own, and the one with sharp textures
    this._inputs = inputsTarget();
    this._material = Object.assign(new NodeMaterial(), { name: "supersampler inputs", blending: NoBlending });
    this._quad = new QuadMesh(this._material);
    this._output = Object.assign(new StorageTexture(1, 1), { name: "supersampler", type: HalfFloatType, generateMipmaps: false });
    this._textureNode = passTexture(this, beautyNode.value);
    this._textureNode.mergeable = false; // merged with nodes of the pass, while it shows that, it would change them, too
  }

  /** @returns {import("three/webgpu").TextureNode} the upscaled image */
  getTextureNode() {
    return this._textureNode;
  }

  /** Drops the history: call it at a cut of the camera. */
  reset() {
    this._isReset = true;
  }

  /** Frees the memory, and lets the pass sample its textures as before. */
  dispose() {
    super.dispose();
    this._resolveReady();
    for (const [pass, { own, sharp }] of this._contexts)
      if (pass.contextNode === sharp) Object.assign(pass, { contextNode: own, needsUpdate: true });
    for (const resource of [this._fallback, this._inputs, this._material, this._output]) resource?.dispose();
    this._upscaler?.destroy();
    this._upscaler = null;
    this._isDisposed = true;
  }

  setup(builder) {
    const { renderer, renderPipeline } = builder;
    if (this._fallback || !renderer.backend.isWebGPUBackend) return this._setupFallback(builder);
    for (const node of [this.depthNode, this.velocityNode, this.beautyNode]) node.build(builder);
    const samples = this.depthNode.value.renderTarget?.samples;
    if (samples > 1) throw new UpscalerError("the pass", `rendered with ${samples} samples a pixel`, "one sample", ANTIALIAS);
    const { passNode, textureName } = this.velocityNode;
    if (passNode?.isPassNode && !passNode.getMRT()?.has(textureName)) throw new UpscalerError("velocity", "not rendered by the pass", "an output of it", VELOCITY);
    const state = builder.context.renderPipelineState;
    if (renderPipeline && !state.viewOffsetOwner) {
      state.viewOffsetOwner = this;
      OnBeforeRenderPipeline(() => this._offsetView(renderer));
      OnAfterRenderPipeline(() => this._clearView());
    }
    if (state && state.viewOffsetOwner !== this) throw new UpscalerError("the render pipeline", "jittered by another node", "one such node", PIPELINES);
    this._sharpen();
    this._renderPipeline = renderPipeline;
    this._material.contextNode = context(builder.getSharedContext());
    this._material.fragmentNode = this._inputNodes(renderer);
    if (!this._loading) this._loading = this._load(renderer);
    return this._textureNode;
  }

  updateBefore({ renderer }) {
    if (this._fallback) return;
    const { width, height } = this._textureNode.value = this.beautyNode.value;
    if (!this._upscaler || !Math.min(...displaySize(renderer), width, height)) return;
    if (!this._jitter) this._followCamera([width, height], renderer); // the first frame of a render pipeline has no jitter
    const jitter = this._jitter ?? [0, 0];
    try {
      if (!this._areOfOneSize(width, height)) return;
      this._resize(renderer);
      this._drawInputs(renderer, jitter);
      this._upscale(renderer, jitter);
    } catch (error) { // thrown through three.js, it would leave the renderer without tone mapping
      this._fallBack(error);
      return;
    }
    this._textureNode.value = this._output;
    this._previousClip.copy(this._clip);
    this._isReset = false;
  }

  _setupFallback(builder) {
    if (!this._fallback) this._fallBack(new Error("This browser or device has no WebGPU, so that three.js draws with WebGL."));
    this._fallback.build(builder);
    this._textureNode.value = this._fallback.getTextureNode().value;
    return this._textureNode;
  }

  /** @param {Error} error why this node cannot upscale */
  _fallBack({ message }) {
    console.error(`supersampler: ${message.replace(/\.$/, "")}. The image is upscaled by three.js' own TAAU node instead.`);
    this._fallback = taau(this.beautyNode, this.depthNode, this.velocityNode, this.camera);
    this._upscaler?.destroy();
    this._upscaler = null;
    this._resolveReady();
    if (this._renderPipeline) this._renderPipeline.needsUpdate = true;
  }

  async _load(renderer) {
    try {
      const { default: files } = await models[this.method]();
      const size = displaySize(renderer).map((side) => Math.max(side, 1)); // a hidden canvas may have no pixels yet
      const upscaler = await Upscaler.load(renderer.backend.device, (name) => files[name], { displaySize: size });
      if (this._isDisposed) upscaler.destroy();
      else this._upscaler = upscaler;
      this._resolveReady();
    } catch (error) {
      if (!this._isDisposed) this._fallBack(error);
    }
  }

  /** The pass that renders depth. Nodes may lie between a pass and the colour. */
  get _pass() {
    return passOf(this.depthNode);
  }

  /** Lets the passes sample their textures as sharply as at display size, with the context that they have. */
  _sharpen() {
    for (const pass of new Set([this._pass, passOf(this.beautyNode)])) {
      if (!pass || this._contexts.get(pass)?.sharp === pass.contextNode) continue;
      const own = pass.contextNode, sharp = sharpTextures(this._uniforms.detail, own);
      this._contexts.set(pass, { own, sharp });
      Object.assign(pass, { contextNode: sharp, needsUpdate: true });
    }
  }

  /** Moves the camera by the jitter, before the pass is rendered. */
  _offsetView(renderer) {
    this._clearView(); // of a frame that an error has ended
    const display = displaySize(renderer), pass = this._pass;
    if (pass) {
      pass.setSize(...display); // as it does itself, but later
      if (this.beautyNode.autoResize) this.beautyNode.setResolutionScale(pass.getResolutionScale());
    }
    const { width, height } = pass ? pass.renderTarget : this.depthNode.value; // a depth texture follows when it is rendered
    if (!this._upscaler || !Math.min(...display, width, height)) return;
    this._followCamera([width, height], renderer);
    const { camera } = this;
    if (camera.coordinateSystem !== renderer.coordinateSystem) return; // never rendered: three.js will set the matrix anew
    const [x, y] = this._jitter = haltonJitter(this._frame++, display[0] / width);
    velocity.setProjectionMatrix(this._projection);
    // A pixel shows its centre + jitter. The matrix is changed, not the view offset: it may be the app's own.
    camera.projectionMatrix.premultiply(new Matrix4().makeTranslation(-2 * x / width, 2 * y / height, 0));
    camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
  }

  /** Takes the size and the camera of this frame. Another camera of the pass is a cut. */
  _followCamera(renderSize, renderer) {
    this._renderSize = renderSize;
    this._uniforms.detail.value = renderSize[0] / displaySize(renderer)[0];
    const { camera } = this._pass ?? this;
    if (camera !== this.camera) {
      this.camera = camera;
      this._isReset = true;
      Object.assign(this._material, { fragmentNode: this._inputNodes(renderer), needsUpdate: true });
    }
    this._projection.copy(camera.projectionMatrix);
  }

  _clearView() {
    if (!this._jitter) return;
    this.camera.projectionMatrix.copy(this._projection);
    this.camera.projectionMatrixInverse.copy(this._projection).invert();
    velocity.setProjectionMatrix(null);
    this._jitter = null;
  }

  /** Returns whether all textures have the size that the frame is jittered for. They may follow a new size one frame late. */
  _areOfOneSize(width, height) {
    const isSame = (size) => size.width === width && size.height === height;
    const name = ["depth", "velocity"].find((one) => !isSame(this[`${one}Node`].value));
    this._mismatches = name ? this._mismatches + 1 : 0;
    if (this._mismatches > 1) {
      const { value } = this[`${name}Node`];
      throw new UpscalerError(name, `${value.width}x${value.height}`, `${width}x${height}, as beauty`, SCALES);
    }
    return !name && isSame({ width: this._renderSize[0], height: this._renderSize[1] });
  }

  _resize(renderer) {
    const [before, display] = [this._upscaler.displaySize, displaySize(renderer)];
    if (display.some((side, axis) => side !== before[axis])) this._upscaler.resize(display);
    this._inputs.setSize(...this._renderSize);
    this._output.setSize(...display);
    renderer.initTexture(this._output);
  }

  /** Draws depth and motion in our units. */
  _drawInputs(renderer, jitter) {
    const { planes, distances, size, toPrevious } = this._uniforms, { near, far } = this.camera;
    this._clip.multiplyMatrices(this._projection, this.camera.matrixWorldInverse);
    if (this._isReset) {
      this._previousClip.copy(this._clip);
      // Depths are compared with those of the history: their unit stays, where an app moves the planes.
      // Planes of an orthographic camera may lie behind it: distances then count from a point before them.
      const shift = near > 0 ? 0 : (far - near) / 10 - near;
      distances.value.set(near + shift, shift);
    }
    planes.value.set(near, far);
    this._uniforms.jitter.value.set(...jitter);
    size.value.set(...this._renderSize);
    toPrevious.value.multiplyMatrices(this._previousClip, this._clip.clone().invert());
    this._rendererState = RendererUtils.resetRendererState(renderer, this._rendererState);
    renderer.setRenderTarget(this._inputs);
    this._quad.render(renderer);
    RendererUtils.restoreRendererState(renderer, this._rendererState);
  }

  _upscale(renderer, jitter) {
    const { backend } = renderer, [color, depth, motion, output] = [this.beautyNode.value, ...this._inputs.textures, this._output]
      .map((texture) => backend.get(texture).texture);
    const encoder = backend.device.createCommandEncoder({ label: "supersampler" });
    this._upscaler.encode(encoder, { color, depth, motion }, output, {
      jitter, reset: this._isReset, exposure: renderer.toneMappingExposure > 0 ? renderer.toneMappingExposure : null,
    });
    backend.device.queue.submit([encoder.finish()]);
  }

  /** Depth: near / view distance, 0 at the sky. Motion: render pixels, y down, previous minus current. */
  _inputNodes(renderer) {
    const { planes, distances, jitter, size, toPrevious } = this._uniforms;
    const [near, far, unit, shift] = [planes.x, planes.y, distances.x, distances.y], isReversed = renderer.reversedDepthBuffer;
    const toViewZ = this.camera.isOrthographicCamera ? orthographicDepthToViewZ
      : renderer.logarithmicDepthBuffer ? logarithmicDepthToViewZ : perspectiveDepthToViewZ;
    const [texel, z] = [ivec2(screenCoordinate), this.depthNode.load(ivec2(screenCoordinate)).r.toVar()];
    const isSky = isReversed ? z.lessThanEqual(0) : z.greaterThanEqual(1);
    const depth = unit.div(shift.sub(toViewZ(z, near, far)));

    // three's velocity is current minus previous, in units of half the image with y up, and 0 at the sky, which moves
    // with the camera.
    const place = screenCoordinate.add(jitter).div(size).mul(vec2(2, -2)).add(vec2(-1, 1)).toVar();
    const previous = toPrevious.mul(vec4(place, isReversed ? 0 : 1, 1)).toVar();
    const moved = isSky.select(place.sub(previous.xy.div(previous.w)), this.velocityNode.load(texel).xy);
    const motion = moved.mul(size).mul(vec2(-0.5, 0.5));
    return outputStruct(vec4(isSky.select(0, depth), 0, 0, 0), vec4(motion, 0, 0));
  }
}

/** Returns the pass that a node is a texture of, or null. */
function passOf({ passNode }) {
  return passNode?.isPassNode ? passNode : null;
}

/** Returns (width, height) of the image. */
function displaySize(renderer) {
  const { width, height } = renderer.getDrawingBufferSize(new Vector2());
  return [width, height];
}

function inputsTarget() {
  const target = new RenderTarget(1, 1, { count: 2, type: FloatType, depthBuffer: false });
  Object.assign(target.textures[0], { name: "depth", format: RedFormat });
  Object.assign(target.textures[1], { name: "motion", format: RGFormat });
  return target;
}

/**
 * @param {import("three/webgpu").Node} beauty colour of the pass, linear, without MSAA
 * @param {import("three/webgpu").TextureNode} depth of the pass @param {import("three/webgpu").TextureNode} velocity of the pass
 * @param {import("three/webgpu").Camera} camera of the pass
 * @param {{ method?: string }} [options] method: "classifier" if not given, or "taau", which is faster
 * @returns {SupersamplerNode}
 * @throws {UpscalerError} there is no such method, or an argument is something else
 */
export function supersampler(beauty, depth, velocity, camera, options = {}) {
  if (!beauty?.isNode) throw new UpscalerError("beauty", shown(beauty), "a node", TEXTURE_NODE);
  for (const [name, node] of Object.entries({ depth, velocity }))
    if (!node?.isTextureNode) throw new UpscalerError(name, node?.isNode ? `a ${node.type}` : shown(node), "a texture node", TEXTURE_NODE);
  if (!camera?.isCamera) throw new UpscalerError("camera", shown(camera), "the camera of the pass");
  const isKnown = options === Object(options) && Object.keys(options).every((name) => name === "method");
  if (!isKnown) throw new UpscalerError("options", shown(options), "{ method }");
  return new SupersamplerNode(convertToTexture(beauty), depth, velocity, camera, options);
}
