/** GPU times of the stages of a frame, by timestamp queries. */

const QUERIES = 4;

export class StageTimer {
  /** @param {GPUDevice} device with the feature timestamp-query */
  constructor(device) {
    this.device = device;
    this.querySet = device.createQuerySet({ type: "timestamp", count: QUERIES });
    this.resolved = device.createBuffer({ size: 8 * QUERIES, usage: GPUBufferUsage.QUERY_RESOLVE | GPUBufferUsage.COPY_SRC });
    this.readable = device.createBuffer({ size: 8 * QUERIES, usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ });
    this.isBusy = false;
  }

  /** For the first raster pass, the last, and the upscaler's passes. */
  get writes() {
    const { querySet } = this;
    return {
      rasterBegin: { querySet, beginningOfPassWriteIndex: 0 },
      rasterEnd: { querySet, endOfPassWriteIndex: 1 },
      upscaling: { querySet, beginningOfPassWriteIndex: 2, endOfPassWriteIndex: 3 },
    };
  }

  /** @param {GPUCommandEncoder} encoder after the passes */
  encode(encoder) {
    if (this.isBusy) return;
    encoder.resolveQuerySet(this.querySet, 0, QUERIES, this.resolved, 0);
    encoder.copyBufferToBuffer(this.resolved, 0, this.readable, 0, 8 * QUERIES);
  }

  /** @returns {Promise<{ raster: number, upscaling: number } | null>} milliseconds; null while an earlier frame is read */
  async read() {
    if (this.isBusy) return null;
    this.isBusy = true;
    await this.readable.mapAsync(GPUMapMode.READ);
    const [a, b, c, d] = new BigInt64Array(this.readable.getMappedRange().slice(0));
    this.readable.unmap();
    this.isBusy = false;
    return { raster: Number(b - a) / 1e6, upscaling: Number(d - c) / 1e6 };
  }
}
