/** A WebGPU device that computes nothing. It throws where a real one would throw or report a wrong number. */

const FORMATS = /^((r|rg|rgba)32float|(r|rg|rgba)32uint|(rg|rgba)16float)$/;
const TEXEL = 16;
const ROOM = 2 ** 32;

export const LIMITS = {
  maxTextureDimension2D: 8192,
  maxBindGroups: 4,
  maxBindingsPerBindGroup: 1000,
  maxUniformBufferBindingSize: 1 << 16,
  maxStorageBufferBindingSize: 1 << 27,
  maxBufferSize: 1 << 28,
  maxComputeWorkgroupsPerDimension: 65535,
  maxStorageBuffersPerShaderStage: 8,
  maxStorageTexturesPerShaderStage: 4,
  maxSampledTexturesPerShaderStage: 16,
  maxComputeInvocationsPerWorkgroup: 256,
  maxComputeWorkgroupSizeX: 256,
  maxComputeWorkgroupSizeY: 256,
  maxComputeWorkgroupStorageSize: 16384,
};

class FakeGpuError extends Error {}

function check(isGood, problem) {
  if (!isGood) throw new FakeGpuError(problem);
}

const isWhole = (value, least, most) => Number.isInteger(value) && value >= least && value <= most;

/** Return a device; `limits` replace those of LIMITS. */
export function fakeDevice(limits = {}) {
  const all = { ...LIMITS, ...limits };
  let taken = 0;
  const take = (bytes) => {
    taken += bytes;
    check(taken <= ROOM, `${taken} bytes are taken`);
  };
  const held = new Set(); // labels of what is not destroyed
  const isHeld = (label) => {
    if (label) held.add(label);
    return { destroy: () => held.delete(label) };
  };
  const made = { buffers: 0 };
  const createBuffer = ({ size, label }) => {
    made.buffers++;
    check(isWhole(size, 1, all.maxBufferSize), `a buffer has ${size} bytes`);
    take(size);
    return { ...isHeld(label), size, unmap() {}, getMappedRange: () => new ArrayBuffer(size) };
  };
  const createTexture = ({ size: [width, height], format, usage = 0, label }) => {
    check(
      [width, height].every((side) => isWhole(side, 1, all.maxTextureDimension2D)),
      `a texture is ${width}x${height}`,
    );
    check(FORMATS.test(format), `a texture is ${format}`);
    take(TEXEL * width * height);
    const texture = { ...isHeld(label), width, height, format, usage, sampleCount: 1 };
    texture.createView = () => ({ texture });
    return texture;
  };
  const createBindGroupLayout = ({ entries }) => {
    const places = entries.map(({ binding }) => binding);
    check(
      places.every((place) => isWhole(place, 0, all.maxBindingsPerBindGroup - 1)),
      `bindings ${places}`,
    );
    check(new Set(places).size === places.length, `bindings ${places}`);
    return { entries };
  };
  const createBindGroup = ({ layout, entries }) => {
    layout.entries.forEach((wanted, index) => {
      const { resource } = entries[index];
      if (!wanted.buffer) return check(resource?.texture, `binding ${wanted.binding} is not a texture`);
      const most =
        wanted.buffer.type === "uniform" ? all.maxUniformBufferBindingSize : all.maxStorageBufferBindingSize;
      const { size, buffer } = resource;
      return check(
        isWhole(size, 1, Math.min(most, buffer.size)),
        `${size} of ${buffer.size} bytes are bound`,
      );
    });
    return { entries };
  };
  return {
    held,
    made,
    limits: all,
    features: new Set(),
    lost: new Promise(() => {}),
    pushErrorScope() {},
    popErrorScope: async () => null,
    createShaderModule: () => ({ getCompilationInfo: async () => ({ messages: [] }) }),
    createComputePipelineAsync: async ({ layout }) => layout,
    createPipelineLayout({ bindGroupLayouts }) {
      check(bindGroupLayouts.length <= all.maxBindGroups, `${bindGroupLayouts.length} bind groups`);
      return { groups: bindGroupLayouts };
    },
    createBuffer,
    createTexture,
    createBindGroupLayout,
    createBindGroup,
    createCommandEncoder: () => encoder(all),
    queue: {
      writeBuffer: (buffer, offset, { byteLength }) =>
        check(byteLength % 4 === 0 && offset + byteLength <= buffer.size, `${byteLength} bytes are written`),
    },
  };
}

function encoder({ maxComputeWorkgroupsPerDimension: most }) {
  const pass = () => {
    let pipeline = null;
    const bound = new Map();
    return {
      setPipeline(one) {
        pipeline = one;
      },
      setBindGroup: (number, group) => bound.set(number, group),
      dispatchWorkgroups(x, y) {
        check(isWhole(x, 1, most) && isWhole(y, 1, most), `${x}x${y} workgroups`);
        pipeline.groups.forEach((_, number) => check(bound.has(number), `group ${number} is not set`));
      },
      end() {},
    };
  };
  return {
    beginComputePass: pass,
    beginRenderPass: ({ colorAttachments: [{ view }] }) => {
      check(view.texture, "an attachment is not a texture");
      return { end() {} };
    },
    clearBuffer: ({ size }) => check(size, "what is cleared is not a buffer"),
    copyBufferToBuffer: (from, at, to, toAt, bytes) =>
      check(
        bytes % 4 === 0 && at + bytes <= from.size && toAt + bytes <= to.size,
        `${bytes} bytes are copied`,
      ),
  };
}
