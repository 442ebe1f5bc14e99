/** The browser's GPU. */

/**
 * @typedef {object} Gpu
 * @property {GPUDevice} device
 * @property {string} adapter its name, for messages
 * @property {boolean} hasTimestamps
 * @property {boolean} isSoftware whether it runs on the processor
 */

/** @returns {Promise<Gpu>} @throws {Error} WebGPU is not available; the message is for the person at the page */
export async function requestGpu() {
  if (!navigator.gpu) throw new Error("This browser has no WebGPU.");
  const adapter = await navigator.gpu.requestAdapter({ powerPreference: "high-performance" });
  if (!adapter) throw new Error("This browser has WebGPU, but found no adapter for it.");
  const hasTimestamps = adapter.features.has("timestamp-query");
  const device = await adapter.requestDevice({ requiredFeatures: hasTimestamps ? ["timestamp-query"] : [] }).catch((error) => {
    throw new Error(`${adapterName(adapter)} gives this page no device: ${error.message}`);
  });
  return { device, adapter: adapterName(adapter), hasTimestamps, isSoftware: adapter.info.isFallbackAdapter };
}

/** @param {GPUAdapter} adapter @returns {string} */
function adapterName({ info }) {
  return info.description || [info.vendor, info.architecture, info.device].filter(Boolean).join(" ") || "an unnamed adapter";
}
