/** The solid spans around a person, fetched from the service ahead of need. */

import type { Service } from "../service/service.ts";
import { Tile } from "./tile.ts";

/** The solid spans at places. */
export interface Solid {
  /** The grid spacing, metres. */
  readonly cell: number;
  /** Lower and upper ends of spans, ascending, in metres; nothing if not known yet. */
  column(x: number, z: number): Float64Array | undefined;
}

/** Columns along a side of a tile. */
const COLUMNS = 64;
/** The most tiles that are kept. */
const MOST = 100;
/** Milliseconds until a failed tile is requested again. */
const AGAIN = 2000;

export class Ground implements Solid {
  readonly #service: Pick<Service, "tile">;
  readonly #side: number;
  /** Known or requested tiles, the most recently used one last. */
  readonly #tiles = new Map<string, Tile | "asked">();
  readonly cell: number;

  /** Tiles have sides of this many metres. */
  constructor(service: Pick<Service, "tile">, side: number) {
    [this.#service, this.#side] = [service, side];
    this.cell = side / COLUMNS;
  }

  column(x: number, z: number): Float64Array | undefined {
    const tile = this.#tile(Math.floor(x / this.#side), Math.floor(z / this.#side));
    return tile?.column(x, z);
  }

  /** Requests all tiles around a place. */
  fetchAround(x: number, z: number): void {
    const [column, row] = [Math.floor(x / this.#side), Math.floor(z / this.#side)];
    for (const right of [0, -1, 1]) {
      for (const back of [0, -1, 1]) {
        this.#tile(column + right, row + back);
      }
    }
  }

  #tile(column: number, row: number): Tile | undefined {
    const key = `${column},${row}`;
    const tile = this.#tiles.get(key);
    this.#tiles.delete(key);
    this.#tiles.set(key, tile ?? "asked");
    if (tile === undefined) {
      void this.#fetch(key, column, row);
    }
    return tile === "asked" ? undefined : tile;
  }

  async #fetch(key: string, column: number, row: number): Promise<void> {
    try {
      this.#tiles.set(key, new Tile(await this.#service.tile(column, row)));
      for (const oldest of this.#tiles.keys()) {
        if (this.#tiles.size <= MOST) {
          break;
        }
        this.#tiles.delete(oldest);
      }
    } catch {
      // The person waits at its edge meanwhile.
      setTimeout(() => this.#tiles.delete(key), AGAIN);
    }
  }
}
