/** What is solid around a person, fetched from the service ahead of need. */

import type { Service } from "../service/service.ts";
import { Tile } from "./tile.ts";

/** What is solid at a place. */
export interface Solid {
  /** The distance between places that may differ, metres. */
  readonly cell: number;
  /** Lower and upper ends of spans, ascending, in metres; nothing where it is not known yet. */
  column(x: number, z: number): Float64Array | undefined;
}

/** Columns along a side of a tile. */
const COLUMNS = 64;
/** Tiles that are kept. */
const MOST = 100;
/** Milliseconds until a tile that did not come is asked for again. */
const AGAIN = 2000;

export class Ground implements Solid {
  readonly #service: Pick<Service, "tile">;
  readonly #side: number;
  /** The tiles that are there or were asked for, the one that was needed last at the end. */
  readonly #tiles = new Map<string, Tile | "asked">();
  readonly cell: number;

  /** Tiles have sides of so many metres. */
  constructor(service: Pick<Service, "tile">, side: number) {
    [this.#service, this.#side] = [service, side];
    this.cell = side / COLUMNS;
  }

  column(x: number, z: number): Float64Array | undefined {
    const tile = this.#tile(Math.floor(x / this.#side), Math.floor(z / this.#side));
    return tile?.column(x, z);
  }

  /** Asks for all tiles around a place. */
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
