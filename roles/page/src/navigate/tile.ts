/** The solid spans in a square of the ground, as sent by the service: `Tile::to_bytes` of `roles/scene`. */

/** Columns with their solid spans. Heights in metres, world. */
export class Tile {
  readonly #x: number;
  readonly #z: number;
  readonly #cell: number;
  readonly #side: number;
  /** The index of each column's first height, and the end behind the last. */
  readonly #starts: Uint32Array;
  /** The lower and upper end of each span. */
  readonly #heights: Float64Array;

  /** Throws if the bytes are not a valid tile. */
  constructor(bytes: ArrayBuffer) {
    const view = new DataView(bytes);
    [this.#x, this.#z] = [view.getFloat64(0, true), view.getFloat64(8, true)];
    const base = view.getFloat64(16, true);
    this.#cell = view.getFloat32(24, true);
    const unit = view.getFloat32(28, true);
    this.#side = view.getUint32(32, true);
    const columns = this.#side * this.#side;
    // Each column has two bytes at least.
    if (!(this.#cell > 0) || !(unit > 0) || columns > bytes.byteLength) {
      throw new RangeError("the service has sent something that is no tile");
    }
    this.#starts = new Uint32Array(columns + 1);
    this.#heights = new Float64Array(bytes.byteLength / 2);
    let [at, used] = [36, 0];
    for (let column = 0; column < columns; column += 1) {
      this.#starts[column] = used;
      const ends = 2 * view.getUint16(at, true);
      at += 2;
      for (let end = 0; end < ends; end += 1) {
        this.#heights[used] = base + unit * view.getUint16(at, true);
        [at, used] = [at + 2, used + 1];
      }
    }
    this.#starts[columns] = used;
  }

  /** The spans at a place of the tile: lower and upper ends, ascending. */
  column(x: number, z: number): Float64Array {
    const column = this.#along(z - this.#z) * this.#side + this.#along(x - this.#x);
    return this.#heights.subarray(this.#starts[column], this.#starts[column + 1]);
  }

  #along(metres: number): number {
    return Math.max(0, Math.min(this.#side - 1, Math.floor(metres / this.#cell)));
  }
}
