/// <reference types="@webgpu/types" />

export type Size = readonly [width: number, height: number];

/** Contents of upscaler.json; docs/how-to/run-the-shaders.md describes them. */
export interface UpscalerInfo {
  format: "supersampler-shaders";
  version: 3;
  method: string;
  precision: "fp32" | "int8";
  target: "wgsl";
  images: "textures";
  ratios: [least: number, largest: number];
  licence: string;
  attributions: string[];
  inputs: {
    name: "color" | "depth" | "motion" | "reactive" | GBuffer | `aovs${number}`;
    unit: string;
    range: [number, number];
    formats: string[];
  }[];
  [other: string]: unknown;
}

export type GBuffer =
  | "gbuffer_base_color"
  | "gbuffer_normal"
  | "gbuffer_display_base_color"
  | "gbuffer_display_normal"
  | "gbuffer_display_depth";

export interface UpscalerFrame extends Partial<Record<GBuffer, GPUTexture>> {
  color: GPUTexture;
  /** Not read by every method; see `info.inputs`. */
  depth?: GPUTexture;
  motion?: GPUTexture;
  /** May be missing, whatever the method. */
  reactive?: GPUTexture | null;
  /** Four channels each; as many as the folder was exported with. */
  aovs?: readonly GPUTexture[];
}

export interface EncodeOptions {
  jitter: readonly [x: number, y: number];
  renderSize?: Size;
  exposure?: number | null;
  preExposure?: number;
  addsSamples?: 0 | 1 | 2;
  reset?: boolean;
  /** Textures like the output, for the blended aovs of the frame. */
  aovs?: readonly GPUTexture[];
  timestamps?: GPUComputePassTimestampWrites;
}

type File = Response | ArrayBuffer | ArrayBufferView | string | undefined;

export class Upscaler {
  static load(
    device: GPUDevice,
    source: string | URL | ((name: string) => File | Promise<File>),
    options: { displaySize: Size },
  ): Promise<Upscaler>;
  private constructor();
  readonly device: GPUDevice;
  readonly info: UpscalerInfo;
  readonly displaySize: Size;
  encode(encoder: GPUCommandEncoder, frame: UpscalerFrame, output: GPUTexture, options: EncodeOptions): void;
  reset(): void;
  /** Change the size of the images, when all encoded steps are submitted. The history is dropped. */
  resize(displaySize: Size): void;
  /** Free the memory on the device, when all encoded steps are submitted. */
  destroy(): void;
}

/** Jitter of a frame, for a display of `ratio` times the render size: render pixels, in [-0.5, 0.5). */
export function haltonJitter(index: number, ratio: number): [x: number, y: number];

export class UpscalerError extends Error {
  constructor(name: string, got: unknown, want: unknown, hint?: string);
}
