/** The browser's GPU. */

/** WebGPU is not available; the message is shown on the page. */
export class NoGpuError extends Error {
  /** @param {string} message */
  constructor(message) {
    super(message);
    this.name = "NoGpuError";
  }
}

/**
 * @typedef {object} Gpu
 * @property {GPUDevice} device
 * @property {string} adapter its name, for messages
 * @property {boolean} hasTimestamps
 * @property {boolean} isSoftware whether it runs on the processor
 */

/** @returns {Promise<Gpu>} @throws {NoGpuError} */
export async function requestGpu() {
  if (!navigator.gpu) throw new NoGpuError("This browser has no WebGPU.");
  const adapter = await navigator.gpu.requestAdapter({ powerPreference: "high-performance" });
  if (!adapter) throw new NoGpuError("This browser has WebGPU, but found no adapter for it.");
  const hasTimestamps = adapter.features.has("timestamp-query");
  const device = await adapter.requestDevice({ requiredFeatures: hasTimestamps ? ["timestamp-query"] : [] }).catch((error) => {
    throw new NoGpuError(`${adapterName(adapter)} gives this page no device: ${error.message}`);
  });
  return { device, adapter: adapterName(adapter), hasTimestamps, isSoftware: adapter.info.isFallbackAdapter };
}

/** @param {GPUAdapter} adapter @returns {string} */
function adapterName({ info }) {
  return info.description || [info.vendor, info.architecture, info.device].filter(Boolean).join(" ") || "an unnamed adapter";
}
