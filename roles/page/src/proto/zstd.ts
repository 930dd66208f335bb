/** One frame of zstd (RFC 8878) of known length. */

import { Decompress } from "fzstd";
import { Reader, WireError } from "trimaran-transport";

/**
 * Unpacks a frame that holds exactly `length` bytes. Anything else throws a `WireError`.
 *
 * The library trusts a frame's declared size, so the frame's headers are checked before.
 */
export function unzstd(frame: Uint8Array, length: number): Uint8Array<ArrayBuffer> {
  checkFrame(frame, length);
  const out = new Uint8Array(length);
  let count = 0;
  const unpacker = new Decompress((chunk) => {
    if (count + chunk.length > length) {
      throw new WireError(`a frame of zstd holds more than ${length} bytes`);
    }
    out.set(chunk, count);
    count += chunk.length;
  });
  try {
    unpacker.push(frame, true);
  } catch (error) {
    throw error instanceof WireError ? error : new WireError(`a frame of zstd cannot be unpacked: ${error}`);
  }
  if (count !== length) {
    throw new WireError(`a frame of zstd holds ${count} bytes, not ${length}`);
  }
  return out;
}

/** The largest window that is accepted: RFC 8878 recommends as much. */
const LARGEST_WINDOW = 8 << 20;

const MAGIC = 0xfd2fb528;

/** Checks that it is one frame, to the end, with reasonable sizes. */
function checkFrame(frame: Uint8Array, length: number): void {
  const reader = new Reader(frame);
  if (reader.u32() !== MAGIC) {
    throw new WireError("it is no frame of zstd");
  }
  const descriptor = reader.u8();
  const isSingleSegment = (descriptor & 0x20) !== 0;
  if ((descriptor & 0x0b) !== 0) {
    throw new WireError("a frame of zstd needs a dictionary, or is of a version to come");
  }
  if (!isSingleSegment && windowOf(reader.u8()) > LARGEST_WINDOW) {
    throw new WireError(`a frame of zstd asks for a window of more than ${LARGEST_WINDOW} bytes`);
  }
  const size = readContentSize(reader, descriptor >>> 6, isSingleSegment);
  if (size !== undefined && size !== BigInt(length)) {
    throw new WireError(`a frame of zstd claims to hold ${size} bytes, not ${length}`);
  }
  passBlocks(reader);
  if ((descriptor & 0x04) !== 0) {
    reader.u32();
  }
  reader.end();
}

function windowOf(descriptor: number): number {
  const base = 2 ** (10 + (descriptor >>> 3));
  return base + (base / 8) * (descriptor & 7);
}

/** The frame's declared content size, if it has one. */
function readContentSize(reader: Reader, code: number, isSingleSegment: boolean): bigint | undefined {
  switch (code) {
    case 0:
      return isSingleSegment ? BigInt(reader.u8()) : undefined;
    case 1:
      return BigInt(reader.u16()) + 256n;
    case 2:
      return BigInt(reader.u32());
    default:
      return reader.u64();
  }
}

/** Skips the blocks of a frame. A block of one repeated byte holds just that byte. */
function passBlocks(reader: Reader): void {
  for (let isLast = false; !isLast; ) {
    const header = reader.u24();
    isLast = (header & 1) !== 0;
    const isRepeated = ((header >>> 1) & 3) === 1;
    reader.bytes(isRepeated ? 1 : header >>> 3);
  }
}
