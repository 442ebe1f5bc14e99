import type { Camera, Node, TextureNode } from "three/webgpu";

export interface SupersamplerOptions {
  /** A method of the package: "classifier" if not given; "taau" is faster. */
  method?: string;
}

/** The upscaled image of a pass, at the size of the renderer's drawing buffer. */
export class SupersamplerNode extends Node<"vec4"> {
  private constructor();
  /** Resolves when images are upscaled, or when three.js' TAAU has taken over. */
  readonly ready: Promise<void>;
  getTextureNode(): TextureNode;
  /** Drop the history: call it at a cut of the camera. */
  reset(): void;
}

/** Upscale a pass, in place of three.js' `taau`. Throws an `UpscalerError` where there is no such method, or where an argument is something else. */
export function supersampler(
  beauty: Node,
  depth: TextureNode,
  velocity: TextureNode,
  camera: Camera,
  options?: SupersamplerOptions,
): SupersamplerNode;
