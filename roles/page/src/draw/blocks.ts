/** Reads buffers of the device in large blocks: each read waits for the device. */

/** Words of four bytes in a block. */
const BLOCK = 1 << 18;
/** The most blocks that are kept: 32 MiB. */
const MOST_BLOCKS = 32;

export class Blocks {
  readonly #gl: WebGL2RenderingContext;
  readonly #blocks = new Map<WebGLBuffer, Map<number, Uint32Array>>();
  #count = 0;

  constructor(gl: WebGL2RenderingContext) {
    this.#gl = gl;
  }

  /** Forgets what was read: buffers have changed, or nothing more is to be read. */
  clear(): void {
    this.#blocks.clear();
    this.#count = 0;
  }

  /** Words from `start` on of a buffer with `capacity` words. */
  read(buffer: WebGLBuffer, capacity: number, start: number, length: number): Uint32Array<ArrayBuffer> {
    const words = new Uint32Array(length);
    for (let done = 0; done < length; ) {
      const number = Math.floor((start + done) / BLOCK);
      const block = this.#block(buffer, capacity, number);
      const from = start + done - number * BLOCK;
      const part = block.subarray(from, from + length - done);
      words.set(part, done);
      // A block ends after its last word, and a buffer holds all of its words.
      done += Math.max(1, part.length);
    }
    return words;
  }

  #block(buffer: WebGLBuffer, capacity: number, number: number): Uint32Array {
    const held = this.#blocks.get(buffer)?.get(number);
    if (held !== undefined) {
      return held;
    }
    if (this.#count >= MOST_BLOCKS) {
      this.clear();
    }
    const gl = this.#gl;
    const block = new Uint32Array(Math.min(BLOCK, capacity - number * BLOCK));
    gl.bindBuffer(gl.COPY_READ_BUFFER, buffer);
    gl.getBufferSubData(gl.COPY_READ_BUFFER, 4 * number * BLOCK, block);
    gl.bindBuffer(gl.COPY_READ_BUFFER, null);
    const own = this.#blocks.get(buffer) ?? new Map<number, Uint32Array>();
    this.#blocks.set(buffer, own.set(number, block));
    this.#count += 1;
    return block;
  }
}
