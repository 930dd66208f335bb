-- Trimaran's messages in Wireshark and tshark: transport/wire/WIRE.md over TCP, transport/udp/WIRE.md over UDP; what is in them has
-- proto/WIRE.md.
--
--   wireshark -X lua_script:proto/wireshark/trimaran.lua capture.pcapng
--
-- Connections are known by their hello, and by the ports 7400 and 7401. Of encrypted datagrams only their headers can be read; QUIC
-- is Wireshark's own. What repair made good at the receiver is not rebuilt here, and said to be missing. Of links of other applications
-- the hello, the kinds of messages and the channels are shown: their hello has the sizes of channels, but not
-- those of the lanes.

local KINDS = {
  [0x01] = "hello", [0x02] = "accept", [0x03] = "refuse", [0x04] = "close", [0x05] = "keep-alive",
  [0x06] = "hello with channels", [0x07] = "accept with version",
  [0x10] = "latest value", [0x11] = "numbered value",
  [0x20] = "begin", [0x21] = "batch", [0x22] = "end", [0x24] = "coded batch",
  [0x30] = "message", [0x40] = "block",
}
-- Of the wire: this release and the one before. Of datagrams.
local HIGHEST, LOWEST, DATAGRAMS = 5, 4, 4
local HEADER, MAGIC, APPLICATION, CAMERA, BEGIN_UNIT = 4, "TRIM", "trimaran/4", 72, 80
local ROLES = { [0] = "culler", "display", "relay" }
local LANES = { [0] = "latest", "frames", "messages", "bulk" }
local MESSAGES = {
  [0] = "stats", "meet", "met", "unmet", "switch", "switched", "part", "view", "waits",
  "lead", "follow", "unfollow", "followed", "unfollowed",
}
-- Items of blocks: what a display says, and what a culler sends.
local DEMANDS = { [0] = "begin", "end", "holds", "lacks", "dropped", "taken", "shown" }
local SUPPLIES = { [0] = "entries", "geometry", "stand-in", "ahead" }
local CODINGS = { [0] = "plain", "changes" }
local OCCLUSION_TESTS = { [0] = "query", "raster", "hzb" }
local REASONS = {
  [0] = "versions differ", "the applications differ", "the application does not take the peer",
  "the lane came twice", "another lane did not come in time", "too many handshakes under way",
  "the key is known for another role", "the channels differ",
}
local REJECTIONS = { [1] = "scenes differ", [3] = "the roles do not go together" }
local CLOSES = {
  [0] = "the session is over", "interrupted", "failed", [4] = "device failed", [5] = "replaced", [65535] = "the listener is not taken",
}
local FORMS = { [0] = "data", "initial", "retry", "answer" }
local PLAIN_FRAME, CODED_FRAME = 0x20, 0x24
local FRAMES_KEPT, TAG = 8, 16
-- A reset has this in place of a number, and a token of this length.
local RESET, TOKEN = UInt64(0xfffffffc, 0xffffffff), 16

local trimaran = Proto("trimaran", "Trimaran")
local datagrams = Proto("trimaran_udp", "Trimaran datagram")

local f = {
  kind = ProtoField.uint8("trimaran.kind", "Kind", base.HEX, KINDS),
  length = ProtoField.uint24("trimaran.length", "Length"),
  version = ProtoField.uint16("trimaran.version", "Version"),
  lowest = ProtoField.uint16("trimaran.version.lowest", "Lowest version"),
  idle_timeout = ProtoField.uint32("trimaran.idle_timeout", "Idle timeout (ms)"),
  protocol = ProtoField.string("trimaran.protocol", "Protocol"),
  application = ProtoField.bytes("trimaran.application", "Another application's"),
  role = ProtoField.uint8("trimaran.role", "Role", base.DEC, ROLES),
  scene = ProtoField.string("trimaran.scene", "Scene"),
  scene_nodes = ProtoField.uint32("trimaran.scene.nodes", "Nodes of the scene"),
  scene_drawables = ProtoField.uint32("trimaran.scene.drawables", "Drawables of the scene"),
  scene_geometries = ProtoField.uint32("trimaran.scene.geometries", "Pieces of geometry of the scene"),
  scene_objects = ProtoField.uint32("trimaran.scene.objects", "Objects of the scene"),
  width = ProtoField.uint32("trimaran.settings.width", "Width"),
  height = ProtoField.uint32("trimaran.settings.height", "Height"),
  epsilon = ProtoField.double("trimaran.settings.epsilon", "Epsilon (px)"),
  batch = ProtoField.uint32("trimaran.settings.batch", "Ids a batch"),
  coding = ProtoField.uint8("trimaran.settings.coding", "Coding", base.DEC, CODINGS),
  occlusion_test = ProtoField.uint8("trimaran.settings.occlusion_test", "Occlusion test", base.DEC, OCCLUSION_TESTS),
  few = ProtoField.bool("trimaran.settings.few_pixels", "Few pixels"),
  session = ProtoField.uint64("trimaran.session", "Session", base.HEX),
  session_key = ProtoField.uint64("trimaran.session_key", "Key of the session", base.HEX),
  lane = ProtoField.uint8("trimaran.lane", "Lane", base.DEC, LANES),
  reason = ProtoField.uint8("trimaran.reason", "Reason", base.DEC, REASONS),
  rejection = ProtoField.uint16("trimaran.rejection", "Rejection", base.DEC, REJECTIONS),
  close = ProtoField.uint16("trimaran.close", "Close", base.DEC, CLOSES),
  text = ProtoField.string("trimaran.text", "Says"),
  number = ProtoField.uint32("trimaran.camera.number", "Number of the camera"),
  eye = ProtoField.double("trimaran.camera.eye", "Eye (m)"),
  orientation = ProtoField.double("trimaran.camera.orientation", "Orientation"),
  tangent = ProtoField.float("trimaran.camera.tangent", "Tangent of half the field of view"),
  seen_in = ProtoField.uint32("trimaran.camera.view", "View state"),
  near = ProtoField.float("trimaran.camera.near", "Near (m)"),
  meant = ProtoField.uint32("trimaran.camera.frame", "Camera of frame"),
  begin = ProtoField.uint32("trimaran.begin", "Begin of frame"),
  count = ProtoField.uint32("trimaran.ids", "Ids"),
  channel = ProtoField.string("trimaran.channel", "Channel"),
  channel_number = ProtoField.uint8("trimaran.channel.number", "Number of the channel"),
  channel_value = ProtoField.uint32("trimaran.channel.value_size", "Bytes of a value"),
  channel_header = ProtoField.uint32("trimaran.channel.header_size", "Bytes of a frame's header"),
  channel_item = ProtoField.uint32("trimaran.channel.item_size", "Bytes of an item"),
  value = ProtoField.bytes("trimaran.channel.value", "Value"),
  header = ProtoField.bytes("trimaran.channel.header", "Header of the frame"),
  items = ProtoField.uint32("trimaran.channel.items", "Items"),
  item_bytes = ProtoField.bytes("trimaran.channel.item_bytes", "Bytes of the items"),
  id = ProtoField.uint32("trimaran.id", "Id"),
  ended = ProtoField.uint32("trimaran.end", "End of frame"),
  total = ProtoField.uint32("trimaran.end.ids", "Ids of the frame"),
  hash = ProtoField.uint64("trimaran.end.hash", "Hash of the ids", base.HEX),
  back = ProtoField.uint32("trimaran.coded.back", "Reference, frames back"),
  place = ProtoField.uint32("trimaran.coded.place", "Ids of the reference before"),
  kept = ProtoField.uint32("trimaran.coded.kept", "Kept"),
  skipped = ProtoField.uint32("trimaran.coded.skipped", "Skipped"),
  put = ProtoField.uint32("trimaran.coded.put", "Put in"),
  said = ProtoField.uint8("trimaran.message", "Message", base.DEC, MESSAGES),
  stats = ProtoField.uint32("trimaran.stats", "Stats of frame"),
  occluders_of = ProtoField.uint32("trimaran.stats.occluders_of", "Occluders of frame"),
  stat = ProtoField.uint64("trimaran.stats.value", "Value"),
  meeting = ProtoField.uint64("trimaran.meeting", "Key of the meeting", base.HEX),
  meet_at = ProtoField.string("trimaran.meet.at", "At"),
  view = ProtoField.uint32("trimaran.view", "View state"),
  view_part = ProtoField.bytes("trimaran.view.part", "Bytes of it"),
  view_last = ProtoField.bool("trimaran.view.last", "Last part"),
  leader = ProtoField.uint64("trimaran.leader", "Leader", base.HEX),
  led_from = ProtoField.uint32("trimaran.leader.first", "From frame of the link on"),
  switch_from = ProtoField.uint32("trimaran.switch.first", "From frame on"),
  block = ProtoField.bytes("trimaran.block", "Bytes of the block"),
  demand = ProtoField.uint8("trimaran.demand", "Demand", base.DEC, DEMANDS),
  coarser_first = ProtoField.bool("trimaran.demand.coarser_first", "Coarser drawables first"),
  demand_ahead = ProtoField.uint64("trimaran.demand.ahead", "Bytes ahead at most"),
  demand_frame = ProtoField.uint32("trimaran.demand.frame", "For frame"),
  taken = ProtoField.uint64("trimaran.demand.taken", "Bytes taken of blocks"),
  drawable = ProtoField.uint32("trimaran.demand.drawable", "Drawable"),
  piece = ProtoField.uint32("trimaran.demand.geometry", "Piece of geometry"),
  supply = ProtoField.uint8("trimaran.supply", "Supply", base.DEC, SUPPLIES),
  packed = ProtoField.bytes("trimaran.supply.entries", "Packed records"),
  records = ProtoField.uint16("trimaran.supply.records", "Records"),
  supply_piece = ProtoField.uint32("trimaran.supply.geometry", "Piece of geometry"),
  supply_length = ProtoField.uint32("trimaran.supply.length", "Length of the piece"),
  supply_offset = ProtoField.uint32("trimaran.supply.offset", "Where the part begins"),
  supply_part = ProtoField.bytes("trimaran.supply.part", "Part"),
  stand_in = ProtoField.uint32("trimaran.supply.stand_in", "Stand-in"),
  stand_in_pieces = ProtoField.uint32("trimaran.supply.stand_in_pieces", "Pieces of the stand-in"),
  stood_in_for = ProtoField.uint32("trimaran.supply.drawable", "Stands in for drawable"),
  supply_ahead = ProtoField.uint32("trimaran.supply.ahead", "Piece of geometry ahead"),
}
local e = {
  malformed = ProtoExpert.new("trimaran.malformed", "No message of versions 4 and 5", expert.group.MALFORMED, expert.severity.ERROR),
}
trimaran.fields, trimaran.experts = f, e

local u = {
  form = ProtoField.uint8("trimaran_udp.form", "Form", base.DEC, FORMS),
  version = ProtoField.uint32("trimaran_udp.version", "Version"),
  packet = ProtoField.uint64("trimaran_udp.packet", "Packet number"),
  connection = ProtoField.uint32("trimaran_udp.connection", "Connection id", base.HEX),
  cookie = ProtoField.bytes("trimaran_udp.cookie", "Cookie"),
  token = ProtoField.bytes("trimaran_udp.token", "Reset token"),
  handshake = ProtoField.bytes("trimaran_udp.handshake", "Handshake message"),
  taken = ProtoField.bool("trimaran_udp.taken", "Taken"),
  listener = ProtoField.uint32("trimaran_udp.listener", "Listener's connection id", base.HEX),
  sealed = ProtoField.bytes("trimaran_udp.sealed", "Sealed chunks"),
  checksum = ProtoField.bytes("trimaran_udp.checksum", "Checksum"),
  pad = ProtoField.uint32("trimaran_udp.pad", "Pads"),
  ping = ProtoField.none("trimaran_udp.ping", "Ping"),
  ack = ProtoField.uint64("trimaran_udp.ack", "Acknowledged up to"),
  ack_first = ProtoField.uint64("trimaran_udp.ack.first", "Acknowledged from"),
  delay = ProtoField.uint64("trimaran_udp.ack.delay", "Delay (us)"),
  max_data = ProtoField.uint64("trimaran_udp.max_data", "Flow control limit (bytes)"),
  units = ProtoField.uint64("trimaran_udp.max_data.units", "Flow control limit (units)"),
  close = ProtoField.none("trimaran_udp.close", "Close"),
  unread = ProtoField.none("trimaran_udp.unread", "Unread"),
  unread_messages = ProtoField.none("trimaran_udp.unread.messages", "Unread messages"),
  messages_max_data = ProtoField.uint64("trimaran_udp.messages.max_data", "Flow control limit of messages (bytes)"),
  messages_units = ProtoField.uint64("trimaran_udp.messages.max_data.units", "Flow control limit of messages (units)"),
  messages_unit = ProtoField.uint64("trimaran_udp.messages.unit", "Unit of the messages lane"),
  unread_blocks = ProtoField.none("trimaran_udp.unread.blocks", "Unread blocks"),
  bulk_max_data = ProtoField.uint64("trimaran_udp.bulk.max_data", "Flow control limit of blocks (bytes)"),
  bulk_units = ProtoField.uint64("trimaran_udp.bulk.max_data.units", "Flow control limit of blocks (units)"),
  bulk_unit = ProtoField.uint64("trimaran_udp.bulk.unit", "Unit of the bulk lane"),
  challenge = ProtoField.bytes("trimaran_udp.challenge", "Challenge"),
  response = ProtoField.bytes("trimaran_udp.response", "Response"),
  camera = ProtoField.uint64("trimaran_udp.camera", "Number of the camera"),
  last = ProtoField.uint64("trimaran_udp.last_camera", "Number of the last camera"),
  unit = ProtoField.uint64("trimaran_udp.unit", "Unit"),
  offset = ProtoField.uint64("trimaran_udp.offset", "Offset"),
  bytes = ProtoField.uint32("trimaran_udp.bytes", "Bytes"),
  part = ProtoField.uint8("trimaran_udp.part", "Part", base.HEX, {
    [0x20] = "more follows", [0x21] = "nothing follows for now", [0x22] = "the unit ends here", [0x23] = "the frame ends here",
    [0x40] = "more of the message follows", [0x42] = "the message ends here",
    [0x50] = "more of the block follows", [0x52] = "the block ends here",
  }),
  hash = ProtoField.uint64("trimaran_udp.hash", "Hash of the frame's ids", base.HEX),
  channel = ProtoField.uint8("trimaran_udp.channel", "Channel"),
  value = ProtoField.uint64("trimaran_udp.value", "Number of the value"),
  last_value = ProtoField.uint64("trimaran_udp.last_value", "Number of the last value"),
  given_up = ProtoField.uint64("trimaran_udp.given_up", "Given up: bytes of the unit"),
  sent = ProtoField.uint64("trimaran_udp.given_up.sent", "Sent of them"),
  ids = ProtoField.uint64("trimaran_udp.given_up.ids", "Ids of the frame"),
  repair = ProtoField.uint16("trimaran_udp.repair", "Repair shard"),
  shard = ProtoField.uint16("trimaran_udp.repair.size", "Size of a shard"),
  rest = ProtoField.bytes("trimaran_udp.repair.bytes", "Bytes of the shard"),
  unseen = ProtoField.uint32("trimaran_udp.repair.unseen", "Bytes of the block that were not seen"),
}
local ue = {
  unseen = ProtoExpert.new("trimaran_udp.not_rebuilt", "Bytes came by repair, which is not rebuilt here", expert.group.UNDECODED, expert.severity.WARN),
  malformed = ProtoExpert.new("trimaran_udp.malformed", "No chunk of version 4", expert.group.MALFORMED, expert.severity.ERROR),
}
datagrams.fields, datagrams.experts = u, ue

-- Reading. A reader walks over a range of bytes; whatever lies outside raises SHORT, which the dissectors catch.

local SHORT = {}

local function reader(tvb, from, to)
  local at = from
  local r = {}
  function r.take(count)
    if at + count > to then error(SHORT) end
    local range = tvb(at, count)
    at = at + count
    return range
  end
  function r.left() return to - at end
  function r.at() return at end
  -- A varint as a number, exact up to 2^53; as UInt64; and where it stands.
  function r.varint(most)
    local start, value, scale, low, high = at, 0, 1, 0, 0
    for group = 0, (most or 10) - 1 do
      local byte = r.take(1):uint()
      local bits = byte % 128
      value = value + bits * scale
      for bit = 0, 6 do
        if math.floor(bits / 2 ^ bit) % 2 == 1 then
          local place = 7 * group + bit
          if place < 32 then low = low + 2 ^ place elseif place < 64 then high = high + 2 ^ (place - 32) end
        end
      end
      scale = scale * 128
      if byte < 128 then return value, UInt64(low, high), tvb(start, at - start) end
    end
    error(SHORT)
  end
  -- A varint of up to 128 bits, as hexadecimal digits.
  function r.hex()
    local start, bits = at, {}
    for group = 0, 18 do
      local byte = r.take(1):uint()
      for bit = 0, 6 do bits[7 * group + bit] = math.floor(byte / 2 ^ bit) % 2 end
      if byte < 128 then break end
    end
    local digits = {}
    for nibble = 31, 0, -1 do
      local value = 0
      for bit = 3, 0, -1 do value = 2 * value + (bits[4 * nibble + bit] or 0) end
      digits[#digits + 1] = string.format("%x", value)
    end
    return table.concat(digits), tvb(start, at - start)
  end
  return r
end

local function add_varint(tree, field, r)
  local value, _, range = r.varint()
  tree:add(field, range, value)
  return value
end

-- The same with all 64 bits.
local function add_wide(tree, field, r)
  local value, wide, range = r.varint()
  tree:add(field, range, wide)
  return value
end

-- Adds a text, and gives it.
local function add_text(tree, field, r)
  local length = r.varint()
  if length == 0 then return "" end
  local range = r.take(length)
  tree:add(field, range)
  return range:string()
end

-- Messages.

local function camera(r, tree)
  local place = r.take(CAMERA)
  local sub = tree:add(place, "Camera")
  for axis = 0, 2 do sub:add_le(f.eye, place(8 * axis, 8)) end
  for part = 0, 3 do sub:add_le(f.orientation, place(24 + 8 * part, 8)) end
  sub:add_le(f.tangent, place(56, 4))
  sub:add_le(f.seen_in, place(60, 4))
  sub:add_le(f.near, place(64, 4))
  sub:add_le(f.meant, place(68, 4))
  return place(68, 4):le_uint()
end

local function settings(r, tree)
  add_varint(tree, f.width, r)
  add_varint(tree, f.height, r)
  tree:add_le(f.epsilon, r.take(8))
  tree:add(f.few, r.take(1))
  add_varint(tree, f.batch, r)
  add_varint(tree, f.coding, r)
  add_varint(tree, f.occlusion_test, r)
end

-- What each direction of each lane has said so far, so that coded ids can be read. Only the first look at a packet adds to it; later
-- ones find there what the first one made of each message.
local lanes, decoded = {}, {}

-- The application of each connection whose hello names another one than Trimaran.
local others = {}

-- The role that each direction of each connection has said: what blocks hold depends on it.
local roles = {}

-- The channels of each connection whose hello has some, and the one that it carries itself, if it carries
-- one.
local channels, carried = {}, {}

function trimaran.init() lanes, decoded, others, roles, channels, carried = {}, {}, {}, {}, {}, {} end

-- `key` names the sender's direction.
local function identity(r, tree, key)
  local role = add_varint(tree, f.role, r)
  roles[key] = role
  local said = ROLES[role] or "?"
  if r.take(1):uint() == 1 then
    local scene, range = r.hex()
    tree:add(f.scene, range, scene)
    for _, field in ipairs({ f.scene_nodes, f.scene_drawables, f.scene_geometries, f.scene_objects }) do add_varint(tree, field, r) end
  else
    said = said .. " without a scene"
  end
  if r.take(1):uint() == 1 then
    add_wide(tree, f.session_key, r)
    settings(r, tree:add("Settings"))
  end
  return said
end

local function pair_of(pinfo)
  local here = tostring(pinfo.src) .. ":" .. pinfo.src_port
  local there = tostring(pinfo.dst) .. ":" .. pinfo.dst_port
  return here < there and here .. "|" .. there or there .. "|" .. here
end

local function direction_of(pinfo)
  return tostring(pinfo.src) .. ":" .. pinfo.src_port .. ">" .. tostring(pinfo.dst) .. ":" .. pinfo.dst_port
end

local function opposite_of(pinfo)
  return tostring(pinfo.dst) .. ":" .. pinfo.dst_port .. ">" .. tostring(pinfo.src) .. ":" .. pinfo.src_port
end

local function lane_of(pinfo)
  local key = direction_of(pinfo)
  lanes[key] = lanes[key] or { kept = {}, order = {}, units = {} }
  return lanes[key]
end

local function begin_frame(lane, frame) lane.open = { frame = frame, ids = {}, whole = true } end

local function end_frame(lane)
  local open = lane.open
  if open and open.whole then
    lane.kept[open.frame] = open.ids
    table.insert(lane.order, open.frame)
    if #lane.order > FRAMES_KEPT then lane.kept[table.remove(lane.order, 1)] = nil end
  end
  lane.open = nil
end

-- Reads coded ids; `reference` may be missing, then only the runs are shown and no ids come back.
local function runs(r, tree, reference, back)
  local ids, place, least = {}, 1, 0
  local function pass(count)
    if count > 0 and reference then
      if reference[place + count - 1] == nil then error(SHORT) end
      least = math.max(least, reference[place + count - 1] + 1)
    end
  end
  if back > 0 then
    local before = add_varint(tree, f.place, r)
    pass(before)
    place = place + before
  end
  local function put(gap)
    local id = least + gap
    ids[#ids + 1] = id
    least = id + 1
  end
  while r.left() > 0 do
    local start = r.at()
    local run = tree:add("Run")
    local word, _, range = r.varint(5)
    local keep, what = math.floor(word / 4), word % 4
    run:add(f.kept, range, keep)
    if keep > 0 and reference then
      if reference[place + keep - 1] == nil then error(SHORT) end
      for index = place, place + keep - 1 do ids[#ids + 1] = reference[index] end
      least = math.max(least, reference[place + keep - 1] + 1)
    end
    place = place + keep
    if what == 0 or what == 2 then
      local count = 1
      if what == 2 then count = add_varint(run, f.skipped, r) else run:add(f.skipped, range, 1) end
      pass(count)
      place = place + count
    else
      local count = 1
      if what == 3 then count = add_varint(run, f.put, r) else run:add(f.put, range, 1) end
      for _ = 1, count do put((r.varint(5))) end
    end
    run:set_len(r.at() - start)
  end
  if back > 0 and not reference then return nil end
  return ids
end

local function coded(r, tree, pinfo, key)
  local whole = r.left()
  local back = add_varint(tree, f.back, r)
  local lane = lane_of(pinfo)
  local reference = nil
  local known = decoded[key]
  if known then
    reference = known.reference
  else
    reference = back > 0 and lane.open and lane.kept[lane.open.frame - back] or nil
  end
  local ids = runs(r, tree, reference, back)
  if not known then
    decoded[key] = { reference = reference }
    if lane.open then
      if ids then
        for _, id in ipairs(ids) do table.insert(lane.open.ids, id) end
      else
        lane.open.whole = false
      end
    end
  end
  if not ids then return "ids as changes against a frame that was not captured whole" end
  tree:add(f.count, #ids):set_generated()
  for _, id in ipairs(ids) do tree:add(f.id, id):set_generated() end
  return string.format("%d ids in %d bytes", #ids, whole)
end

local function plain_ids(r, tree)
  local count = math.floor(r.left() / 4)
  tree:add(f.count, count):set_generated()
  local ids = {}
  for index = 1, count do
    local range = r.take(4)
    tree:add_le(f.id, range)
    ids[index] = range:le_uint()
  end
  return ids
end

local STATS = {
  "OR start (ns)", "OR end (ns)", "OR busy (ns)", "HC start (ns)", "HC end (ns)",
  "device: occluders (ns)", "device: pyramid (ns)", "device: culling (ns)", "occluders", "their triangles",
  "nodes visited", "outside", "tested", "hidden", "visible by a near corner", "visible by the eye inside",
  "visible by a number that is not finite", "drawn for few pixels", "emitted", "refined", "batches of tests",
  "further rounds", "triangles drawn in them", "drawing them, ns", "boxes tested again", "hidden in further rounds",
  "bytes of camera", "bytes of begin", "bytes of ids", "bytes of end", "bytes of control", "bytes of geometry", "bytes of headers",
  "messages",
}

local function stats(r, tree)
  local frame = add_varint(tree, f.stats, r)
  if r.take(1):uint() == 1 then add_varint(tree, f.occluders_of, r) end
  for _, name in ipairs(STATS) do
    if r.left() == 0 then break end
    local _, wide, range = r.varint()
    tree:add(f.stat, range, wide):set_text(name .. ": " .. tostring(wide))
  end
  return "stats of frame " .. frame
end

-- What roles say to each other.
local function said(r, tree)
  local what = add_varint(tree, f.said, r)
  if what == 0 then return stats(r, tree) end
  if (what >= 1 and what <= 5) or what == 8 then add_wide(tree, f.meeting, r) end
  if what >= 9 and what <= 13 then add_wide(tree, f.leader, r) end
  if what == 1 and r.take(1):uint() == 1 then add_text(tree, f.meet_at, r) end
  if what == 7 then
    local version = add_varint(tree, f.view, r)
    local part = r.take(r.varint())
    tree:add(f.view_part, part)
    tree:add(f.view_last, r.take(1))
    return "view state " .. version .. ", " .. part:len() .. " bytes of it"
  end
  if what == 12 or what == 13 then
    return MESSAGES[what] .. " from frame " .. add_varint(tree, f.led_from, r) .. " on"
  end
  if what == 4 then return "switch from frame " .. add_varint(tree, f.switch_from, r) .. " on" end
  return MESSAGES[what] or "message of another kind"
end

-- A list of numbers that rise. Gives how many there are.
local function numbers(r, tree, field)
  local stop, least, count = r.varint(), 0, 0
  stop = stop + r.at()
  while r.at() < stop do
    local gap, _, range = r.varint(5)
    local number = least + gap
    if r.at() > stop or number >= 2 ^ 32 then error(SHORT) end
    tree:add(field, range, number)
    least = number + 1
    count = count + 1
  end
  return count
end

local function demand(r, tree)
  local what = add_varint(tree, f.demand, r)
  if what == 0 then
    local flag = r.take(1)
    if flag:uint() > 1 then error(SHORT) end
    tree:add(f.coarser_first, flag)
    local ahead = add_wide(tree, f.demand_ahead, r)
    local coarser = flag:uint() == 1 and "coarser drawables first and " or ""
    return "begin with " .. coarser .. ahead .. " bytes ahead"
  elseif what == 2 then
    local drawables = numbers(r, tree, f.drawable)
    return "holds " .. drawables .. " drawables and " .. numbers(r, tree, f.piece) .. " pieces"
  elseif what == 3 then
    local frame = add_varint(tree, f.demand_frame, r)
    add_wide(tree, f.taken, r)
    return "frame " .. frame .. " lacks " .. numbers(r, tree, f.drawable) .. " drawables"
  elseif what == 4 then
    return "dropped " .. numbers(r, tree, f.piece) .. " pieces"
  elseif what == 5 then
    return "taken " .. add_wide(tree, f.taken, r) .. " bytes"
  elseif what == 6 then
    return "shown " .. add_varint(tree, f.demand_frame, r)
  end
  if not DEMANDS[what] then error(SHORT) end
  return DEMANDS[what]
end

local function supply(r, tree)
  local what = add_varint(tree, f.supply, r)
  if what == 0 then
    local length, records = r.varint(), r.take(2)
    tree:add_le(f.records, records)
    if length < 2 then error(SHORT) end
    if length > 2 then tree:add(f.packed, r.take(length - 2)) end
    return records:le_uint() .. " records"
  elseif what == 1 then
    local number = add_varint(tree, f.supply_piece, r)
    local length = add_varint(tree, f.supply_length, r)
    local offset = add_varint(tree, f.supply_offset, r)
    local bytes = r.varint()
    if bytes > 0 then tree:add(f.supply_part, r.take(bytes)) end
    return string.format("piece %d from %d to %d of %d", number, offset, offset + bytes, length)
  elseif what == 2 then
    local id = add_varint(tree, f.stand_in, r)
    local pieces = add_varint(tree, f.stand_in_pieces, r)
    local stood_in_for = numbers(r, tree, f.stood_in_for)
    return pieces .. " drawables from " .. id .. " stand in for " .. stood_in_for .. " drawables"
  elseif what == 3 then
    return numbers(r, tree, f.supply_ahead) .. " pieces ahead"
  end
  error(SHORT)
end

-- So many items of a block the information column names.
local MOST_SAID = 4

-- Who sends a block, or who gets it, was said by the hellos of the connection; without these only the bytes are shown.
local function block(r, tree, pinfo)
  local bytes = r.left()
  local from, to = roles[direction_of(pinfo)], roles[opposite_of(pinfo)]
  if not from and to then from = 1 - to end
  local item, said = from == 0 and supply or from == 1 and demand, {}
  while item and r.left() > 0 do
    local start = r.at()
    local sub = tree:add("Item")
    said[#said + 1] = item(r, sub)
    sub:set_len(r.at() - start)
  end
  if r.left() > 0 then tree:add(f.block, r.take(r.left())) end
  local more = #said > MOST_SAID and ", and " .. #said - MOST_SAID .. " more" or ""
  local items = #said > 0 and ": " .. table.concat(said, ", ", 1, math.min(#said, MOST_SAID)) or ""
  return "block of " .. bytes .. " bytes" .. items .. more
end

-- A channel has a name, and the sizes of its values, or of its headers and items.
local function read_channel(r, tree)
  local channel = { name = add_text(tree, f.channel, r) }
  if r.varint() == 0 then
    channel.value = add_varint(tree, f.channel_value, r)
  else
    channel.header = add_varint(tree, f.channel_header, r)
    channel.item = add_varint(tree, f.channel_item, r)
  end
  return channel
end

local function read_channels(r, tree)
  local list = {}
  for number = 1, r.varint() do list[number] = read_channel(r, tree:add("Channel " .. number - 1)) end
  return list
end

-- Adds the lane, and gives it with the range of the number of a channel, if it is one.
local function add_lane(r, tree)
  local lane = add_varint(tree, f.lane, r)
  local channel = lane == 4 and r.take(1) or nil
  if channel then tree:add(f.channel_number, channel) end
  return lane, channel
end

local function refusal(r, tree)
  local version = r.take(2)
  tree:add_le(f.version, version)
  local layout = version:le_uint()
  if layout < LOWEST or layout > HIGHEST then return "refuse by version " .. layout end
  local reason = add_varint(tree, f.reason, r)
  local said = "refuse: " .. (REASONS[reason] or "?")
  if reason == 0 then
    -- The listener's and the connecting peer's, in version 4 one each, later the highest and the lowest.
    while r.left() > 0 do add_varint(tree, f.version, r) end
  elseif reason == 1 then
    add_text(tree, f.protocol, r)
    add_text(tree, f.protocol, r)
  elseif reason == 2 then
    said = said .. ": " .. (REJECTIONS[add_varint(tree, f.rejection, r)] or "?")
    add_text(tree, f.text, r)
  elseif reason == 3 or reason == 4 then
    add_wide(tree, f.session, r)
    if reason == 3 then add_lane(r, tree) end
  elseif reason == 6 then
    while r.left() > 0 do add_text(tree, f.text, r) end
  elseif reason == 7 then
    tree:add(f.channel_number, r.take(1))
    for _, side in ipairs({ "The listener's channel", "The connecting peer's channel" }) do
      if r.take(1):uint() == 1 then read_channel(r, tree:add(side)) end
    end
  end
  return said
end

local function foreign(r, tree, said)
  if r.left() > 0 then tree:add(f.application, r.take(r.left())) end
  return said
end

local function channel_value(r, tree, channel)
  if channel.value > 0 then tree:add(f.value, r.take(channel.value)) end
  return "value of " .. channel.name
end

-- A message on a channel's own connection, behind its header.
local function channel_message(r, tree, kind, channel)
  if kind == 0x10 and channel.value then
    return channel_value(r, tree, channel)
  elseif kind == 0x20 and channel.item then
    local number = r.take(4)
    tree:add_le(f.begin, number)
    if channel.header > 0 then tree:add(f.header, r.take(channel.header)) end
    return "begin " .. number:le_uint() .. " of " .. channel.name
  elseif kind == 0x21 and channel.item then
    if r.left() % channel.item ~= 0 then error(SHORT) end
    local count = r.left() / channel.item
    tree:add(f.items, count):set_generated()
    tree:add(f.item_bytes, r.take(r.left()))
    return string.format("%d items of %s", count, channel.name)
  elseif kind == 0x22 and channel.item then
    local number = r.take(4)
    tree:add_le(f.ended, number)
    tree:add_le(f.items, r.take(4))
    tree:add_le(f.hash, r.take(8))
    return "end " .. number:le_uint() .. " of " .. channel.name
  end
  return foreign(r, tree, KINDS[kind] .. " of channel " .. channel.name)
end

-- One message, header included. Says what it is. `key` tells it from all others in the capture.
local function message(tvb, from, to, pinfo, tree, key)
  local r = reader(tvb, from, to)
  local header = r.take(HEADER)
  local kind = header(0, 1):uint()
  local name = KINDS[kind] or "unknown"
  local sub = tree:add(trimaran, tvb(from, to - from), "Trimaran " .. name)
  sub:add(f.kind, header(0, 1))
  sub:add_le(f.length, header(1, 3))
  local lane = lane_of(pinfo)
  local first = not decoded[key]
  if kind == 0x01 or kind == 0x06 then
    r.take(#MAGIC)
    local version = r.take(2)
    sub:add_le(f.version, version)
    local highest, lowest = version:le_uint(), version
    if highest > 4 then
      lowest = r.take(2)
      sub:add_le(f.lowest, lowest)
    end
    if highest < LOWEST or lowest:le_uint() > HIGHEST then return "hello of version " .. highest end
    local protocol = add_text(sub, f.protocol, r)
    add_wide(sub, f.session, r)
    local at, channel = add_lane(r, sub)
    add_varint(sub, f.idle_timeout, r)
    local list = kind == 0x06 and read_channels(r, sub) or {}
    local carries = channel and list[channel:uint() + 1]
    channels[pair_of(pinfo)], carried[pair_of(pinfo)] = list, carries
    local which = carries and "channel " .. carries.name or LANES[at] or "?"
    others[pair_of(pinfo)] = protocol ~= APPLICATION and protocol or nil
    if protocol ~= APPLICATION then return foreign(r, sub, "hello of " .. protocol .. ", " .. which) end
    return "hello from " .. identity(r, sub, direction_of(pinfo)) .. ", " .. which
  elseif kind == 0x05 then
    return name
  end
  local accept = kind == 0x02 or kind == 0x07
  if kind == 0x07 then sub:add_le(f.version, r.take(2)) end
  if accept then add_varint(sub, f.idle_timeout, r) end
  if carried[pair_of(pinfo)] and KINDS[kind] then
    return channel_message(r, sub, kind, carried[pair_of(pinfo)])
  elseif others[pair_of(pinfo)] then
    return foreign(r, sub, name .. " of " .. others[pair_of(pinfo)])
  elseif accept then
    return "accept from " .. identity(r, sub, direction_of(pinfo))
  elseif kind == 0x03 then
    return refusal(r, sub)
  elseif kind == 0x04 then
    local why = add_varint(sub, f.close, r)
    add_text(sub, f.text, r)
    return "close: " .. (CLOSES[why] or "?")
  elseif kind == 0x10 then
    return "camera of frame " .. camera(r, sub)
  elseif kind == 0x11 then
    sub:add_le(f.number, r.take(4))
    return "camera of frame " .. camera(r, sub)
  elseif kind == 0x20 then
    local number = r.take(4)
    sub:add_le(f.begin, number)
    camera(r, sub)
    if first then begin_frame(lane, number:le_uint()) end
    decoded[key] = decoded[key] or {}
    return "begin " .. number:le_uint()
  elseif kind == 0x21 then
    local ids = plain_ids(r, sub)
    if first and lane.open then
      for _, id in ipairs(ids) do table.insert(lane.open.ids, id) end
    end
    decoded[key] = decoded[key] or {}
    return #ids .. " ids"
  elseif kind == 0x22 then
    local number = r.take(4)
    sub:add_le(f.ended, number)
    sub:add_le(f.total, r.take(4))
    sub:add_le(f.hash, r.take(8))
    if first then end_frame(lane) end
    decoded[key] = decoded[key] or {}
    return "end " .. number:le_uint()
  elseif kind == 0x24 then
    return coded(r, sub, pinfo, key)
  elseif kind == 0x30 then
    return said(r, sub)
  elseif kind == 0x40 then
    return block(r, sub, pinfo)
  end
  sub:add_proto_expert_info(e.malformed)
  return "unknown kind"
end

-- Whatever reads beyond a message's end marks the tree.
local function guarded(tree, mark, read, ...)
  local fine, said = pcall(read, ...)
  if fine then return said end
  if said ~= SHORT then error(said) end
  tree:add_proto_expert_info(mark)
  return "malformed"
end

local function note(pinfo, protocol, said)
  pinfo.cols.protocol = protocol
  if tostring(pinfo.cols.info):find(protocol, 1, true) == nil then
    pinfo.cols.info = protocol .. ": " .. said
  else
    pinfo.cols.info:append("; " .. said)
  end
end

-- Over TCP.

local function message_length(tvb, _, at)
  return HEADER + tvb(at + 1, 3):le_uint()
end

local ordinal = { packet = 0, count = 0 }

local function tcp_message(tvb, pinfo, tree)
  if ordinal.packet ~= pinfo.number then ordinal = { packet = pinfo.number, count = 0 } end
  ordinal.count = ordinal.count + 1
  local key = pinfo.number .. "/" .. ordinal.count
  note(pinfo, "Trimaran", guarded(tree, e.malformed, message, tvb, 0, tvb:len(), pinfo, tree, key))
  return tvb:len()
end

function trimaran.dissector(tvb, pinfo, tree)
  -- A capture that begins within a connection does not begin with a message.
  if tvb:len() >= 1 and not KINDS[tvb(0, 1):uint()] then return 0 end
  ordinal = { packet = 0, count = 0 }
  dissect_tcp_pdus(tvb, tree, HEADER, message_length, tcp_message)
  return tvb:len()
end

local function begins_with_hello(tvb, at)
  if tvb:len() < at + 8 or tvb(at + 4, 4):string() ~= MAGIC then return false end
  local kind = tvb(at, 1):uint()
  return kind == 0x01 or kind == 0x06
end

trimaran:register_heuristic("tcp", function(tvb, pinfo, tree)
  if not begins_with_hello(tvb, 0) then return false end
  pinfo.conversation = trimaran
  trimaran.dissector(tvb, pinfo, tree)
  return true
end)
DissectorTable.get("tcp.port"):add("7400-7401", trimaran)

-- Over UDP.

-- Gathers the parts of a frame's unit. Says whether its batches have headers (a coded frame), and gives all of it to the part that
-- makes it whole. Only the first look at a packet adds anything; later ones find there what it found.
--
-- Whether a frame is coded its first byte says. Where that was lost, it is taken to be as the frames before it: a link codes all or none.
local function gather(lane, key, unit, offset, range, ends)
  local found = decoded[key .. "/unit"]
  if found then return found end
  local whole = lane.units[unit] or { parts = {} }
  lane.units[unit] = whole
  if range then
    table.insert(whole.parts, { from = offset, to = offset + range:len(), bytes = range:bytes() })
    if offset == 0 then
      whole.coded = range(0, 1):uint() == CODED_FRAME
      lane.coded = whole.coded
    end
  end
  if whole.coded == nil then whole.coded = lane.coded end
  if ends then whole.size = offset + (range and range:len() or 0) end
  found = { coded = whole.coded }
  decoded[key .. "/unit"] = found
  if not whole.size or whole.done then return found end
  local bytes, at = ByteArray.new(), 0
  while at < whole.size do
    local before = at
    for _, part in ipairs(whole.parts) do
      if part.from <= at and part.to > at then
        bytes:append(part.bytes:subset(at - part.from, part.to - at))
        at = part.to
      end
    end
    if at == before then return found end
  end
  whole.done, whole.parts = true, {}
  found.bytes = bytes
  return found
end

-- How many bytes of a block had not come before the repair that `key` names: it stands in for them, unless they were only late. Of that,
-- too, later looks find what the first one found.
local function unseen(lane, key, unit, from, to)
  local found = decoded[key .. "/repair"]
  if found then return found end
  local whole, seen = lane.units[unit], 0
  if whole and whole.done then
    seen = to - from
  elseif whole then
    table.sort(whole.parts, function(a, b) return a.from < b.from end)
    local at = from
    for _, part in ipairs(whole.parts) do
      local begins, ends = math.max(part.from, at), math.min(part.to, to)
      if ends > begins then
        seen = seen + ends - begins
        at = ends
      end
    end
  end
  decoded[key .. "/repair"] = to - from - seen
  return to - from - seen
end

-- Remembers a plain frame, which has no messages but its begin.
local function remember(lane, bytes)
  local function word(at)
    local a, b, c, d = string.byte(bytes:raw(at, 4), 1, 4)
    return a + 256 * b + 65536 * c + 16777216 * d
  end
  begin_frame(lane, word(HEADER))
  for at = BEGIN_UNIT, bytes:len() - 4, 4 do table.insert(lane.open.ids, word(at)) end
  end_frame(lane)
end

local function coded_frame(bytes, tree, pinfo, key)
  local tvb = bytes:tvb("Trimaran coded frame")
  local at, index, said = 1, 0, {}
  while at < tvb:len() do
    index = index + 1
    if at + HEADER > tvb:len() then error(SHORT) end
    local to = at + HEADER + tvb(at + 1, 3):le_uint()
    if to > tvb:len() then error(SHORT) end
    said[index] = message(tvb, at, to, pinfo, tree, key .. "/" .. index)
    at = to
  end
  if not decoded[key .. "/ended"] then end_frame(lane_of(pinfo)) end
  decoded[key .. "/ended"] = true
  return table.concat(said, ", ")
end

local function unit_part(r, tvb, tree, pinfo, unit, offset, count, ends, key)
  local from = r.at()
  local range = count > 0 and r.take(count) or nil
  local first = range and offset == 0 and range(0, 1):uint() or nil
  if first and first ~= PLAIN_FRAME and first ~= CODED_FRAME then
    return message(tvb, from, from + count, pinfo, tree, key)
  end
  local lane = lane_of(pinfo)
  local found = gather(lane, key, unit, offset, range, ends)
  if found.coded == nil then return "part of a frame whose beginning was not captured" end
  if found.coded then
    if not found.bytes then return "part of a coded frame" end
    return coded_frame(found.bytes, tree, pinfo, key)
  end
  if not range then return "nothing" end
  local said = {}
  local skip = 0
  if offset == 0 and count >= BEGIN_UNIT then
    said[1] = message(tvb, from, from + BEGIN_UNIT, pinfo, tree, key)
    skip = BEGIN_UNIT
  elseif offset < BEGIN_UNIT then
    skip = BEGIN_UNIT - offset
  else
    -- A part may begin within an id.
    skip = (4 - (offset - BEGIN_UNIT) % 4) % 4
  end
  local ids = math.floor((count - skip) / 4)
  if ids > 0 then
    local sub = tree:add(trimaran, range(skip, 4 * ids), "Trimaran ids")
    sub:add(f.count, ids):set_generated()
    for index = 0, ids - 1 do sub:add_le(f.id, range(skip + 4 * index, 4)) end
    said[#said + 1] = ids .. " ids"
  end
  if found.bytes and not found.remembered and found.bytes:len() >= BEGIN_UNIT then
    found.remembered = true
    remember(lane, found.bytes)
  end
  return table.concat(said, ", ")
end

-- A part of a frame whose items are not Trimaran's.
local function foreign_part(r, tree, offset, count)
  if count == 0 then return "nothing" end
  local range = r.take(count)
  if offset > 0 or count < HEADER + 4 or range(0, 1):uint() ~= PLAIN_FRAME then return "part of a frame" end
  tree:add_le(f.begin, range(HEADER, 4))
  return "begin " .. range(HEADER, 4):le_uint()
end

-- `channel`: what is known of the lane if it is not Trimaran's; nothing, unless it is a channel.
local function chunk(r, tvb, tree, pinfo, key, channel)
  local start = r.at()
  local code = r.take(1):uint()
  if code == 0x00 then
    local count = 1
    while r.left() > 0 and tvb(r.at(), 1):uint() == 0 do
      r.take(1)
      count = count + 1
    end
    tree:add(u.pad, tvb(start, count), count)
    return nil
  elseif code == 0x01 then
    tree:add(u.ping, tvb(start, 1))
    return "ping"
  elseif code == 0x02 then
    local sub = tree:add("Acknowledgement")
    add_wide(sub, u.delay, r)
    local ranges = r.varint()
    if ranges < 1 or ranges > 32 then error(SHORT) end
    local last, _, range = r.varint()
    local newest = last
    local length = r.varint()
    for index = 1, ranges do
      sub:add(u.ack, range, UInt64(last % 2 ^ 32, math.floor(last / 2 ^ 32)))
      local least = last - length + 1
      sub:add(u.ack_first, range, UInt64(least % 2 ^ 32, math.floor(least / 2 ^ 32)))
      if index < ranges then
        local missing
        missing, _, range = r.varint()
        last = least - missing - 1
        length = r.varint()
      end
    end
    sub:set_len(r.at() - start)
    return "ack " .. newest
  elseif code == 0x03 then
    add_wide(tree, u.max_data, r)
    add_wide(tree, u.units, r)
    return "max data"
  elseif code == 0x04 then
    tree:add(u.close, tvb(start, 1))
    return "close"
  elseif code == 0x05 then
    tree:add(u.unread, tvb(start, 1))
    return "unread"
  elseif code == 0x06 then
    tree:add(u.challenge, r.take(24))
    return "challenge"
  elseif code == 0x07 then
    tree:add(u.response, r.take(24))
    return "response"
  elseif code == 0x08 then
    add_wide(tree, u.messages_max_data, r)
    add_wide(tree, u.messages_units, r)
    return "max data of messages"
  elseif code == 0x09 then
    tree:add(u.unread_messages, tvb(start, 1))
    return "unread messages"
  elseif code == 0x0a then
    add_wide(tree, u.bulk_max_data, r)
    add_wide(tree, u.bulk_units, r)
    return "max data of blocks"
  elseif code == 0x0b then
    tree:add(u.unread_blocks, tvb(start, 1))
    return "unread blocks"
  elseif code == 0x0c then
    local number = r.take(1)
    local known = not (channel and channel.name) and (channels[pair_of(pinfo)] or {})[number:uint() + 1]
    if not known then error(SHORT) end
    local sub = tree:add("Channel " .. known.name)
    sub:add(u.channel, number)
    local said = chunk(r, tvb, sub, pinfo, key .. "/" .. number:uint(), known)
    sub:set_len(r.at() - start)
    return known.name .. ": " .. (said or "pads")
  elseif code == 0x10 and channel then
    local number = add_wide(tree, u.value, r)
    -- The size of the latest lane's values is the application's, and no hello has it.
    if not channel.name then return foreign(r, tree, "value " .. number .. ", and what follows it") end
    if not channel.value then error(SHORT) end
    channel_value(r, tree, channel)
    return "value " .. number
  elseif code == 0x11 and channel then
    local last = add_wide(tree, u.last_value, r)
    local length = r.take(2):le_uint()
    if length > 0 then tree:add(f.application, r.take(length)) end
    return "last value " .. last
  elseif code == 0x10 then
    add_wide(tree, u.camera, r)
    return "camera of frame " .. camera(r, tree)
  elseif code == 0x11 then
    local last = add_wide(tree, u.last, r)
    local length = r.take(2):le_uint()
    if length > 0 then
      local from = r.at()
      r.take(length)
      message(tvb, from, from + length, pinfo, tree, key)
    end
    return "last camera " .. last
  elseif code >= 0x20 and code <= 0x23 then
    local sub = tree:add("Part")
    sub:add(u.part, tvb(start, 1))
    local unit = add_wide(sub, u.unit, r)
    local offset = add_wide(sub, u.offset, r)
    local length = r.take(2)
    sub:add_le(u.bytes, length)
    if code == 0x23 then sub:add_le(u.hash, r.take(8)) end
    local ends = code >= 0x22
    local count = length:le_uint()
    local said = channel and foreign_part(r, sub, offset, count)
      or unit_part(r, tvb, sub, pinfo, unit, offset, count, ends, key)
    sub:set_len(r.at() - start)
    return "unit " .. unit .. ": " .. said .. (code == 0x23 and ", end" or "")
  elseif code == 0x40 or code == 0x42 or code == 0x50 or code == 0x52 then
    local what = code < 0x50 and "message" or "block"
    local sub = tree:add("Part of a " .. what)
    sub:add(u.part, tvb(start, 1))
    local unit = add_wide(sub, code < 0x50 and u.messages_unit or u.bulk_unit, r)
    local offset = add_wide(sub, u.offset, r)
    local length = r.take(2)
    sub:add_le(u.bytes, length)
    local from, count = r.at(), length:le_uint()
    if count > 0 then r.take(count) end
    sub:set_len(r.at() - start)
    -- Most messages are one part; of the others, and of most blocks, the parts are named.
    local whole = offset == 0 and (code == 0x42 or code == 0x52) and count > 0
    local said = whole and message(tvb, from, from + count, pinfo, sub, key) or count == 0 and "nothing" or "part of a " .. what
    return what .. " " .. unit .. ": " .. said
  elseif code == 0x24 or code == 0x25 then
    local sub = tree:add("Give-up")
    local unit = add_wide(sub, u.unit, r)
    add_wide(sub, u.given_up, r)
    add_wide(sub, u.sent, r)
    sub:add_le(u.hash, r.take(8))
    if code == 0x25 then add_wide(sub, u.ids, r) end
    r.take((r.varint()))
    sub:set_len(r.at() - start)
    return "unit " .. unit .. " given up"
  elseif code == 0x30 or code == 0x33 then
    local sub = tree:add("Repair")
    local unit = add_wide(sub, u.unit, r)
    local offset = add_wide(sub, u.offset, r)
    local length = r.varint()
    local size = r.take(2)
    sub:add_le(u.shard, size)
    r.take(1)
    sub:add(u.repair, r.take(1))
    if code == 0x33 then sub:add_le(u.hash, r.take(8)) end
    sub:add(u.rest, r.take(size:le_uint()))
    sub:set_len(r.at() - start)
    if channel then return "unit " .. unit .. " repair" end
    local lacks = unseen(lane_of(pinfo), key, unit, offset, offset + length)
    if lacks == 0 then return "unit " .. unit .. " repair" end
    sub:add(u.unseen, lacks):set_generated()
    local said = "not rebuilt: " .. lacks .. " bytes of unit " .. unit .. " came by repair, or come later"
    sub:add_proto_expert_info(ue.unseen, said)
    return "unit " .. unit .. " repair (" .. said .. ")"
  end
  error(SHORT)
end

local function chunks(tvb, from, to, pinfo, tree)
  local r = reader(tvb, from, to)
  local said, index = {}, 0
  while r.left() > 0 do
    index = index + 1
    said[#said + 1] = chunk(r, tvb, tree, pinfo, pinfo.number .. "/" .. index, others[pair_of(pinfo)] and {})
  end
  return table.concat(said, "; ")
end

-- Whether a connection is in the clear: known from its initial, which has the hello where nothing seals it.
local clear = {}

function datagrams.init() clear = {} end

local function handshake(tvb, from, to, pinfo, tree, form)
  if to <= from then return "empty" end
  local at = from
  if form == 3 and clear[pair_of(pinfo)] then
    tree:add(u.taken, tvb(at, 1))
    tree:add_le(u.listener, tvb(at + 1, 4))
    if tvb(at, 1):uint() ~= 0 then tree:add(u.token, tvb(at + 5, TOKEN)) end
    at = at + 5 + (tvb(at, 1):uint() ~= 0 and TOKEN or 0)
  end
  -- Links put their hello into the first message and their answer into the second.
  if clear[pair_of(pinfo)] and at + HEADER <= to and KINDS[tvb(at, 1):uint()] then
    local length = HEADER + tvb(at + 1, 3):le_uint()
    if at + length <= to then return message(tvb, at, at + length, pinfo, tree, pinfo.number .. "/h") end
  end
  tree:add(u.handshake, tvb(from, to - from))
  return "sealed"
end

local function packet(tvb, pinfo, tree)
  local size = tvb:len()
  if size < 12 then error(SHORT) end
  local form = tvb(0, 1):uint() % 4
  local sub = tree:add(datagrams, tvb(), "Trimaran datagram, " .. FORMS[form])
  sub:add(u.form, tvb(0, 1), form)
  local word = tvb(0, 8):le_uint64()
  sub:add_le(u.connection, tvb(8, 4))
  if word == RESET then
    sub:add(u.token, tvb(12, TOKEN))
    return "reset"
  elseif form == 0 then
    sub:add(u.packet, tvb(0, 8), word:rshift(2))
    if size < 12 + TAG then error(SHORT) end
    if clear[pair_of(pinfo)] then
      sub:add(u.checksum, tvb(size - TAG, TAG))
      local said = guarded(sub, ue.malformed, chunks, tvb, 12, size - TAG, pinfo, sub)
      local other = others[pair_of(pinfo)]
      return other and "chunks of " .. other .. ": " .. said or said
    end
    sub:add(u.sealed, tvb(12, size - 12))
    return "sealed, " .. (size - 12 - TAG) .. " bytes of chunks"
  end
  sub:add(u.version, tvb(0, 8), word:rshift(2):tonumber())
  if form == 1 then
    local r = reader(tvb, 12, size)
    if r.take(1):uint() == 1 then sub:add(u.cookie, r.take(24)) end
    local length = r.take(2):le_uint()
    local from = r.at()
    r.take(length)
    if clear[pair_of(pinfo)] == nil then clear[pair_of(pinfo)] = begins_with_hello(tvb, from) end
    return "initial: " .. handshake(tvb, from, from + length, pinfo, sub, form)
  elseif form == 2 then
    sub:add(u.cookie, tvb(12))
    return "retry"
  end
  return "answer: " .. handshake(tvb, 12, size, pinfo, sub, form)
end

function datagrams.dissector(tvb, pinfo, tree)
  note(pinfo, "Trimaran/UDP", guarded(tree, ue.malformed, packet, tvb, pinfo, tree))
  return tvb:len()
end

-- An initial has 1,200 bytes at least, this version, and zeros behind its handshake; that is told from QUIC by its first byte.
datagrams:register_heuristic("udp", function(tvb, pinfo, tree)
  if tvb:len() < 1200 or tvb(0, 8):le_uint64() ~= UInt64(DATAGRAMS * 4 + 1, 0) then return false end
  local cookie = tvb(12, 1):uint()
  if cookie > 1 then return false end
  local at = 13 + 24 * cookie
  local length = tvb(at, 2):le_uint()
  if at + 2 + length > tvb:len() then return false end
  local rest = tvb:len() - (at + 2 + length)
  if rest > 0 and tvb(at + 2 + length, rest):bytes():tohex():find("[^0]") then return false end
  pinfo.conversation = datagrams
  datagrams.dissector(tvb, pinfo, tree)
  return true
end)
