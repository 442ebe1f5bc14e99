/** GPU times of the stages of a frame, by timestamp queries. */

const QUERIES = 5;

/** @typedef {{ raster: number, upscaling: number, views: number }} StageTimes milliseconds; they add up to those of the frame */

export class StageTimer {
  /** @param {GPUDevice} device with the feature timestamp-query */
  constructor(device) {
    this.device = device;
    this.querySet = device.createQuerySet({ type: "timestamp", count: QUERIES });
    this.resolved = device.createBuffer({ size: 8 * QUERIES, usage: GPUBufferUsage.QUERY_RESOLVE | GPUBufferUsage.COPY_SRC });
    this.readable = device.createBuffer({ size: 8 * QUERIES, usage: GPUBufferUsage.COPY_DST | GPUBufferUsage.MAP_READ });
    this.isBusy = false;
  }

  /** For the first raster pass, the last, the upscaler's passes, and the pass that draws the views. */
  get writes() {
    const { querySet } = this;
    return {
      rasterBegin: { querySet, beginningOfPassWriteIndex: 0 },
      rasterEnd: { querySet, endOfPassWriteIndex: 1 },
      upscaling: { querySet, beginningOfPassWriteIndex: 2, endOfPassWriteIndex: 3 },
      views: { querySet, endOfPassWriteIndex: 4 },
    };
  }

  /** @param {GPUCommandEncoder} encoder after the passes */
  encode(encoder) {
    if (this.isBusy) return;
    encoder.resolveQuerySet(this.querySet, 0, QUERIES, this.resolved, 0);
    encoder.copyBufferToBuffer(this.resolved, 0, this.readable, 0, 8 * QUERIES);
  }

  /** @returns {Promise<StageTimes | null>} null while an earlier frame is read */
  async read() {
    if (this.isBusy) return null;
    this.isBusy = true;
    await this.readable.mapAsync(GPUMapMode.READ);
    const [rasterBegin, rasterEnd, upscalingBegin, upscalingEnd, end] = new BigInt64Array(this.readable.getMappedRange().slice(0));
    this.readable.unmap();
    this.isBusy = false;
    const milliseconds = (from, to) => Number(to - from) / 1e6;
    return {
      raster: milliseconds(rasterBegin, rasterEnd), upscaling: milliseconds(upscalingBegin, upscalingEnd), views: milliseconds(upscalingEnd, end),
    };
  }
}
