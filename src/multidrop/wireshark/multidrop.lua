-- Wireshark dissector of multidrop: SLINK3, Micro-DCI Datalink, Ultra3000 host commands.
--
-- For captures as multidrop writes them: one packet is one frame, or one run of bytes that belong to
-- none. Link types: USER0 SLINK3, USER1 Datalink, USER2 Ultra3000, USER3 bytes of no known protocol.
-- `multidrop wireshark --install` puts this file where Wireshark looks for it.
--
-- Wireshark 4.0 and newer, Lua 5.2 to 5.4: no operator or library that one of them lacks.

-- Tables, written by docs/generate.py from the protocols' own. A row is first, last, text; %X stands
-- for the number in hex with the digits given.
-- tables: begin
local SLINK3_COMMANDS = {
   { 0x0000, 0x001F, "unknown %04Xh" },
   { 0x0020, 0x0020, "reset slave" },
   { 0x0021, 0x0021, "state read" },
   { 0x0022, 0x0022, "state change" },
   { 0x0023, 0x0023, "status word" },
   { 0x0024, 0x0024, "read standard parameter" },
   { 0x0025, 0x0025, "write standard parameter" },
   { 0x0026, 0x0026, "read typed parameter" },
   { 0x0027, 0x0027, "write typed parameter" },
   { 0x0028, 0x0028, "broadcast command verify" },
   { 0x0029, 0x0029, "parameter upload" },
   { 0x002A, 0x002A, "parameter download" },
   { 0x002B, 0x002B, "continue transfer" },
   { 0x002C, 0x002C, "multiple parameters read" },
   { 0x002D, 0x002D, "remote keypad" },
   { 0x002E, 0x002E, "slave description" },
   { 0x002F, 0x002F, "malfunction code" },
   { 0x0030, 0x0030, "read object dictionary" },
   { 0x0031, 0x0031, "write object dictionary" },
   { 0x0032, 0x0032, "sequence" },
   { 0x0033, 0x0033, "end sequence" },
   { 0x0034, 0x0034, "reset sequence" },
   { 0x0035, 0x0035, "run command sequence" },
   { 0x0036, 0x0036, "end transfer" },
   { 0x0037, 0x004F, "unknown %04Xh" },
   { 0x0050, 0x009F, "not used %04Xh" },
   { 0x00A0, 0x00FF, "unknown %04Xh" },
   { 0x0100, 0xABCC, "user defined %04Xh" },
   { 0xABCD, 0xABCD, "special access" },
   { 0xABCE, 0xFF00, "user defined %04Xh" },
   { 0xFF01, 0xFFFF, "unknown %04Xh" },
}
local SLINK3_RESPONSES = {
   { 0x0000, 0x0000, "OK" },
   { 0x0001, 0x0001, "parameter does not exist" },
   { 0x0002, 0x0002, "reserved response %04Xh" },
   { 0x0003, 0x0003, "control access denied" },
   { 0x0004, 0x0004, "reserved response %04Xh" },
   { 0x0005, 0x0005, "attribute access denied" },
   { 0x0006, 0x0006, "the parameter has another type" },
   { 0x0007, 0x000F, "reserved response %04Xh" },
   { 0x0010, 0x0010, "destination option does not exist" },
   { 0x0011, 0x0011, "parameter access conflict" },
   { 0x0012, 0x0012, "above the maximum" },
   { 0x0013, 0x0013, "below the minimum" },
   { 0x0014, 0x0014, "value not supported" },
   { 0x0015, 0x0015, "parameter configuration conflict" },
   { 0x0016, 0x0016, "command submitted, its outcome is unknown" },
   { 0x0017, 0x0017, "reserved response %04Xh" },
   { 0x0018, 0x0018, "unknown command" },
   { 0x0019, 0x0019, "the parameter is read-only" },
   { 0x001A, 0x001A, "write not allowed" },
   { 0x001B, 0x001B, "out of the constant limits" },
   { 0x001C, 0x001C, "the state does not allow it" },
   { 0x001D, 0x001D, "password protection" },
   { 0x001E, 0x001E, "type unknown" },
   { 0x001F, 0x007F, "reserved response %04Xh" },
   { 0x0080, 0x0080, "transfer ended" },
   { 0x0081, 0x0081, "a broadcast was received" },
   { 0x0082, 0x0096, "reserved response %04Xh" },
   { 0x0097, 0x0097, "frame error (parity, overrun)" },
   { 0x0098, 0x00FC, "reserved response %04Xh" },
   { 0x00FD, 0x00FD, "protocol error: LENGTH is wrong" },
   { 0x00FE, 0x00FE, "protocol error" },
   { 0x00FF, 0x00FF, "not OK" },
   { 0x0100, 0xFFFF, "user defined response %04Xh" },
}
local SLINK3_TYPES = {
   { 0x00, 0x00, "auto" },
   { 0x01, 0x01, "bool" },
   { 0x02, 0x02, "int8" },
   { 0x03, 0x03, "int16" },
   { 0x04, 0x04, "int32" },
   { 0x05, 0x05, "uint8" },
   { 0x06, 0x06, "uint16" },
   { 0x07, 0x07, "uint32" },
   { 0x08, 0x08, "float32" },
   { 0x09, 0x09, "string" },
   { 0x0A, 0x0A, "bytes" },
   { 0x0B, 0x1F, "type%02Xh" },
}
local SLINK3_LAYOUTS = {
   [0x00] = "bytes",
   [0x01] = "?1",
   [0x02] = "i1",
   [0x03] = "i2",
   [0x04] = "i4",
   [0x05] = "u1",
   [0x06] = "u2",
   [0x07] = "u4",
   [0x08] = "f4",
   [0x09] = "string",
   [0x0A] = "bytes",
   [0x0F] = "bytes",
   [0x10] = "bytes",
}
local SLINK3_TYPED = { [0x26] = true, [0x27] = true }
local SLINK3_STANDARD = { [0x24] = true, [0x25] = true }
local SLINK3_READS = { [0x24] = true, [0x26] = true }
local SLINK3_SUCCESS = { [0x00] = true, [0x81] = true }
local SLINK3_START = 0x01
local SLINK3_STATUS_WORD = 0x0023
local SLINK3_MALFUNCTION_CODE = 0x002f
local DATALINK_COMMANDS = {
   { 0x20, 0x20, "response" },
   { 0x80, 0x80, "acknowledge" },
   { 0xA0, 0xA0, "change" },
   { 0xC0, 0xC0, "change bits" },
   { 0xE0, 0xE0, "interrogate" },
}
local DATALINK_INTERROGATE = 0xe0
local DATALINK_CHANGE = 0xa0
local DATALINK_CHANGE_BITS = 0xc0
local DATALINK_ACKNOWLEDGE = 0x80
local DATALINK_RESPONSE = 0x20
local DATALINK_SOH = 0x7e
local DATALINK_MOST_DATA = 32
local ULTRA3000_FUNCTIONS = {
   { 0x00, 0x00, "read working" },
   { 0x01, 0x01, "write working" },
   { 0x02, 0x02, "read non volatile" },
   { 0x03, 0x03, "write non volatile" },
   { 0x04, 0x04, "copy non volatile to working" },
   { 0x05, 0x05, "copy working to non volatile" },
   { 0x06, 0x06, "read default" },
   { 0x07, 0x07, "copy default" },
   { 0x08, 0x08, "read minimum" },
   { 0x09, 0x09, "read maximum" },
   { 0x0A, 0x0A, "read index minimum" },
   { 0x0B, 0x0B, "read index maximum" },
   { 0x0C, 0x0F, "reserved function %01Xh" },
}
local ULTRA3000_REFUSALS = {
   { 0x00, 0x00, "unlisted refusal %02Xh" },
   { 0x01, 0x01, "invalid data" },
   { 0x02, 0x02, "the command is not enabled" },
   { 0x03, 0x03, "EEPROM write error" },
   { 0x04, 0x04, "below the minimum" },
   { 0x05, 0x05, "above the maximum" },
   { 0x06, 0x06, "not while the drive is enabled" },
   { 0x07, 0x07, "invalid array index" },
   { 0x08, 0x08, "invalid function code, or no such parameter" },
   { 0x09, 0xFF, "unlisted refusal %02Xh" },
}
local ULTRA3000_READS = { [0x00] = true, [0x02] = true, [0x06] = true, [0x08] = true, [0x09] = true, [0x0A] = true, [0x0B] = true }
local ULTRA3000_WRITES = { [0x01] = true, [0x03] = true }
local ULTRA3000_LONGEST = 255
-- tables: end

-- Words --------------------------------------------------------------------------------------------

local function text_of(rows, number)
   for _, row in ipairs(rows) do
      if row[1] <= number and number <= row[2] then return (row[3]:format(number)) end
   end
end

-- The same rows for the value strings of a field, which shows the number itself.
local function value_strings(rows)
   local found = {}
   for index, row in ipairs(rows) do
      found[index] = { row[1], row[2], (row[3]:gsub(" ?%%%d*Xh?", "")) }
   end
   return found
end

local function hex(bytes) return bytes:len() == 0 and "" or bytes:bytes():tohex(false, " ") end

-- A float as Python writes it: the fewest digits that give the number back.
local function float_text(number)
   if number ~= number then return "nan" end
   if number == math.huge then return "inf" end
   if number == -math.huge then return "-inf" end
   local digits = 0
   local text
   repeat
      digits = digits + 1
      text = ("%." .. (digits - 1) .. "e"):format(number)
   until tonumber(text) == number or digits == 17
   local exponent = tonumber(text:match("e(.*)$"))
   if exponent < -4 or exponent >= 16 then return text end
   return (("%%.%df"):format(math.max(digits - 1 - exponent, 1)):format(number))
end

local ESCAPES = { ["\t"] = "\\t", ["\n"] = "\\n", ["\r"] = "\\r", ["\\"] = "\\\\" }

-- Latin-1 text, or plain bytes, in quotes as Python writes them.
local function quoted(raw, plain_bytes)
   local quote = (raw:find("'", 1, true) and not raw:find('"', 1, true)) and '"' or "'"
   local text = raw:gsub("[%c\127-\255'\"\\]", function(char)
      local code = char:byte()
      if char == quote then return "\\" .. char end
      if char == "'" or char == '"' then return char end
      if ESCAPES[char] then return ESCAPES[char] end
      if plain_bytes or code < 0xA1 or code == 0xAD then return ("\\x%02x"):format(code) end
      return string.char(0xC0 + math.floor(code / 64), 0x80 + code % 64)
   end)
   return (plain_bytes and "b" or "") .. quote .. text .. quote
end

local NIBBLES = {} -- exclusive or of two hex digits: neither bit library is in every Lua
for one = 0, 15 do
   for other = 0, 15 do
      local result, a, b = 0, one, other
      for _, bit in ipairs { 1, 2, 4, 8 } do
         if a % 2 ~= b % 2 then result = result + bit end
         a, b = math.floor(a / 2), math.floor(b / 2)
      end
      NIBBLES[one * 16 + other] = result
   end
end

local function xor(one, other)
   local low = NIBBLES[one % 16 * 16 + other % 16]
   return low + 16 * NIBBLES[math.floor(one / 16) * 16 + math.floor(other / 16)]
end

local function sum(bytes, from, to) -- of a ByteArray, its ends included
   local total = 0
   for index = from, to do total = total + bytes:get_index(index) end
   return total % 256
end

-- What the capture says of a packet -------------------------------------------------------------------

-- Where nobody wants a packet's fields, Wireshark leaves these away on its first pass (tshark -2 without a
-- filter). Then lines of the same protocol in one capture are taken for one, with the usual baud rate.
local packet = {
   comment = Field.new("frame.comment"),
   flags = Field.new("frame.packet_flags"),
   interface = Field.new("frame.interface_id"),
   description = Field.new("frame.interface_description"),
}

local function said(name)
   local info = packet[name]()
   return info and info.value
end

local function marked_damage() return (tonumber(tostring(said("flags") or 0)) or 0) >= 0x10000 end

-- Time of one character on the wire, s: the capture's interface says "PROTOCOL BAUD 8E1".
local function character_time(default)
   local baud, data, parity, stop = tostring(said("description") or ""):match(" (%d+) ([78])([NEO])([12])")
   if not baud then return default end
   return (1 + data + (parity == "N" and 0 or 1) + stop) / baud
end

-- What all protocols have in common ---------------------------------------------------------------------

local function common_fields(name, fields)
   fields.checksum_status = ProtoField.uint8(name .. ".checksum.status", "Checksum status", base.DEC,
      { [0] = "Bad", [1] = "Good" })
   fields.checksum_computed = ProtoField.uint8(name .. ".checksum.computed", "Checksum computed", base.HEX)
   fields.damage = ProtoField.string(name .. ".damage", "Damage")
   fields.damaged = ProtoField.bytes(name .. ".damaged", "Damaged bytes", base.SPACE)
   fields.request_in = ProtoField.framenum(name .. ".request_in", "Request in", base.NONE, frametype.REQUEST)
   fields.response_in = ProtoField.framenum(name .. ".response_in", "Response in", base.NONE, frametype.RESPONSE)
   fields.response_time = ProtoField.relative_time(name .. ".response_time", "Response time")
   fields.echo_of = ProtoField.framenum(name .. ".echo_of", "Local echo of", base.NONE)
   return fields
end

local function common_experts(name)
   return {
      checksum = ProtoExpert.new(name .. ".expert.checksum", "Wrong checksum", expert.group.CHECKSUM, expert.severity.ERROR),
      cut_short = ProtoExpert.new(name .. ".expert.cut_short", "Cut short", expert.group.MALFORMED, expert.severity.ERROR),
      damage = ProtoExpert.new(name .. ".expert.damage", "Bytes of no frame", expert.group.MALFORMED, expert.severity.ERROR),
      no_response = ProtoExpert.new(name .. ".expert.no_response", "No response", expert.group.SEQUENCE, expert.severity.NOTE),
      no_request = ProtoExpert.new(name .. ".expert.no_request", "Answers nothing that was asked",
         expert.group.SEQUENCE, expert.severity.NOTE),
   }
end

local SENT, HEARD, UNKNOWN = 0, 1, -1 -- pinfo.p2p_dir; sent by whoever made the capture
local function refused_expert(name)
   return ProtoExpert.new(name .. ".expert.refused", "Refused", expert.group.RESPONSE_CODE, expert.severity.NOTE)
end

local LATE = 1.5 -- s; an answer that comes later answers nobody

-- Who asked, who answered. Filled in on the first pass, in the order of the packets.
local seen, open = {}, {}

local function forget() seen, open = {}, {} end

local function answers(protocol, frame, question)
   return protocol.is_answer(frame) and protocol.answers(frame, question)
end

-- Whether this is the copy of the frame before, which a line that hears itself delivers: multidrop's own rule.
local function echoes(protocol, frame, questions)
   local last = questions.last
   if not last or last.raw ~= frame.raw then return false end
   local overlaps = frame.start < last.time - frame.character / 2
   local ambiguous = answers(protocol, frame, last)
   if last.direction ~= SENT then return frame.direction == UNKNOWN and overlaps and not ambiguous end
   if frame.direction == SENT or frame.start >= last.time + LATE then return false end
   return overlaps or questions.echoes == true or not ambiguous
end

local function answered(protocol, frame, questions)
   local key, question = protocol.question(frame, questions)
   if not question or not answers(protocol, frame, question) then return end
   if frame.start >= question.time + LATE then return end
   if frame.direction ~= UNKNOWN and frame.direction == question.direction then return end
   questions[key] = nil
   question.entry.response = frame.packet
   local entry = { role = "response", question = question, time = frame.time - question.time }
   protocol.answered(frame, question, questions, entry)
   return entry
end

local function remember(protocol, frame, pinfo)
   local interface = tostring(said("interface") or 0)
   local questions = open[interface] or {}
   open[interface] = questions
   frame.packet, frame.time, frame.direction = pinfo.number, pinfo.rel_ts, pinfo.p2p_dir
   frame.character = character_time(protocol.character)
   frame.start = frame.time - #frame.raw * frame.character
   local last = questions.last
   if echoes(protocol, frame, questions) then
      questions.last, questions.echoes = nil, true
      return { role = "echo", of = last.packet }
   end
   questions.last = frame
   local entry = answered(protocol, frame, questions)
   if entry then return entry end
   if frame.direction ~= SENT and not protocol.may_ask(frame) then return { role = "stray" } end
   local sure = frame.direction == SENT or protocol.from_master(frame)
   entry = { role = "request", expects = protocol.expects(frame), sure = sure }
   frame.entry = entry
   protocol.asked(frame, questions, entry)
   return entry
end

local function conversation(protocol, frame, pinfo, at)
   local key = pinfo.number .. ":" .. at
   if not pinfo.visited then seen[key] = remember(protocol, frame, pinfo) end
   local entry = seen[key] or { role = "stray" }
   if pinfo.visited and entry.role == "request" and not entry.sure and not entry.response then
      entry.role = "stray" -- it could have been either, and nobody answered
   end
   return entry
end

local function generated(tree, field, value)
   local item = tree:add(field, value)
   item:set_generated()
   return item
end

local function time_of(seconds)
   local whole = math.floor(seconds)
   return NSTime.new(whole, math.floor((seconds - whole) * 1e9 + 0.5))
end

local function show_conversation(protocol, entry, tree, pinfo)
   local f = protocol.f
   if entry.role == "response" then
      generated(tree, f.request_in, entry.question.packet)
      generated(tree, f.response_time, time_of(entry.time))
   elseif entry.role == "echo" then
      generated(tree, f.echo_of, entry.of)
   elseif entry.role == "stray" then
      tree:add_proto_expert_info(protocol.e.no_request)
   elseif entry.response then
      generated(tree, f.response_in, entry.response)
   elseif entry.expects and pinfo.visited then
      tree:add_proto_expert_info(protocol.e.no_response)
   end
end

local function show_checksum(protocol, tree, field, range, value, computed)
   local f = protocol.f
   tree:add(field, range, value)
   local item = generated(tree, f.checksum_status, value == computed and 1 or 0)
   if value ~= computed then
      generated(tree, f.checksum_computed, computed)
      item:add_proto_expert_info(protocol.e.checksum)
   end
end

local function show_damage(protocol, range, reason, tree)
   local reported = marked_damage() and said("comment")
   reason = tostring(reported or reason)
   tree:add(protocol.f.damage, range, reason)
   tree:add(protocol.f.damaged, range)
   if reason == "cut short" then
      tree:add_proto_expert_info(protocol.e.cut_short)
   elseif not reason:find("^checksum") and not reason:find("^LRC") then
      tree:add_proto_expert_info(protocol.e.damage, reason)
   end
   return "! " .. reason
end

local function add_text(texts, text) texts[#texts + 1] = text end

-- One packet: as a rule one frame. Bytes of no frame are damage up to where a frame begins.
local function dissect(protocol, tvb, pinfo, root)
   pinfo.cols.protocol = protocol.title
   local tree = root:add(protocol.proto, tvb())
   local texts, at = {}, 0
   local damaged = marked_damage()
   while at < tvb:len() do
      local size, frame = protocol.front(tvb, at)
      if size and not damaged then
         local entry = conversation(protocol, frame, pinfo, at)
         protocol.show(frame, entry, tree, pinfo)
         show_conversation(protocol, entry, tree, pinfo)
         add_text(texts, protocol.describe(frame))
         at = at + size
      else
         local start = at
         repeat at = at + 1 until at == tvb:len() or not damaged and protocol.front(tvb, at)
         protocol.show_part(tvb(start, at - start), tree)
         add_text(texts, show_damage(protocol, tvb(start, at - start), frame, tree))
      end
   end
   local text = table.concat(texts, "; ")
   tree:append_text(", " .. text)
   pinfo.cols.info = text
end

local function register(protocol, link_type)
   protocol.proto.fields = protocol.f
   protocol.proto.experts = protocol.e
   protocol.proto.init = forget
   function protocol.proto.dissector(tvb, pinfo, root) dissect(protocol, tvb, pinfo, root) end
   DissectorTable.get("wtap_encap"):add(link_type, protocol.proto)
end

local function from_to(pinfo, address, answer)
   address = ("%d"):format(address)
   pinfo.cols.src = answer and address or "master"
   pinfo.cols.dst = answer and "master" or address
end

-- SLINK3 ------------------------------------------------------------------------------------------------

local slink3 = { title = "SLINK3", character = 11 / 9600 }
slink3.proto = Proto("slink3", "SLINK3")
slink3.e = common_experts("slink3")
slink3.e.refused = refused_expert("slink3")
slink3.e.fault = ProtoExpert.new("slink3.expert.fault", "The slave is in fault", expert.group.RESPONSE_CODE, expert.severity.WARN)
slink3.f = common_fields("slink3", {
   start = ProtoField.uint8("slink3.start", "START", base.HEX),
   address = ProtoField.uint8("slink3.address", "ADDRESS", base.DEC),
   control = ProtoField.uint8("slink3.control", "CONTROL", base.HEX),
   number = ProtoField.uint8("slink3.number", "Sequence number", base.DEC, nil, 0xFC),
   length = ProtoField.uint8("slink3.length", "LENGTH", base.DEC),
   order = ProtoField.uint8("slink3.order", "ORDER/INFOS", base.HEX),
   answer = ProtoField.bool("slink3.answer", "Sent by a slave", 8, nil, 0x01),
   destination = ProtoField.uint8("slink3.destination", "Destination ID", base.DEC, nil, 0x0E),
   fault = ProtoField.bool("slink3.fault", "Slave in fault", 8, nil, 0x10),
   code = ProtoField.uint16("slink3.code", "COMMAND or RESPONSE", base.HEX),
   command = ProtoField.uint16("slink3.command", "COMMAND", base.RANGE_STRING + base.HEX, value_strings(SLINK3_COMMANDS)),
   response = ProtoField.uint16("slink3.response", "RESPONSE", base.RANGE_STRING + base.HEX, value_strings(SLINK3_RESPONSES)),
   data = ProtoField.bytes("slink3.data", "DATA", base.SPACE),
   format = ProtoField.uint8("slink3.format", "FORMAT", base.HEX),
   type = ProtoField.uint8("slink3.type", "Type", base.RANGE_STRING + base.HEX, value_strings(SLINK3_TYPES), 0x1F),
   has_subindex = ProtoField.bool("slink3.has_subindex", "With SUBINDEX", 8, nil, 0x80),
   index = ProtoField.uint16("slink3.index", "INDEX", base.DEC_HEX),
   subindex = ProtoField.uint8("slink3.subindex", "SUBINDEX", base.DEC),
   value = ProtoField.bytes("slink3.value", "VALUE", base.SPACE),
   integer = ProtoField.int64("slink3.value.integer", "Value", base.DEC),
   float = ProtoField.double("slink3.value.float", "Value"),
   text = ProtoField.string("slink3.value.text", "Value"),
   status_word = ProtoField.uint16("slink3.status_word", "Status word", base.HEX),
   malfunction = ProtoField.uint16("slink3.malfunction_code", "Malfunction code", base.HEX),
   checksum = ProtoField.uint8("slink3.checksum", "CHECKSUM", base.HEX),
})

local function has(set, code) return set[code] == true end

-- Value of a typed parameter: its text, the field it goes to and what is put there; nil for a wrong width.
local function slink3_value(code, range)
   local size, layout = range:len(), SLINK3_LAYOUTS[code]
   if layout == nil then return end
   if layout == "string" then
      local text = range:raw():gsub("\0+$", "")
      return quoted(text), "text", quoted(text)
   elseif layout == "bytes" then
      return quoted(range:raw(), true)
   elseif size ~= tonumber(layout:sub(2)) then
      return
   elseif layout:sub(1, 1) == "?" then
      local set = range:uint() ~= 0
      return set and "True" or "False", "integer", Int64.new(set and 1 or 0)
   elseif layout:sub(1, 1) == "f" then
      return float_text(range:le_float()), "float", range:le_float()
   end
   local number = layout:sub(1, 1) == "i" and range:le_int() or range:le_uint()
   return ("%d"):format(number), "integer", Int64.new(number)
end

-- FORMAT, INDEX and SUBINDEX at the front of DATA, and where VALUE begins.
local function slink3_typed(data)
   if data:len() < 3 then return end
   local format = data(0, 1):uint()
   local found = { format = data(0, 1), type = format % 32, index = data(1, 2), has_subindex = format >= 128 }
   if found.has_subindex then
      if data:len() < 4 then return end
      found.subindex = data(3, 1)
   end
   found.size = found.subindex and 4 or 3
   return found
end

local function rest(data, size) return data:len() > size and data(size) or nil end

local function slink3_typed_text(found)
   local subindex = found.subindex and (".%d"):format(found.subindex:uint()) or ""
   return ("%d%s:%s"):format(found.index:le_uint(), subindex, text_of(SLINK3_TYPES, found.type))
end

local function slink3_typed_answer(data)
   local found = slink3_typed(data)
   local value = found and rest(data, found.size)
   local known = found and data(0, 1):uint() % 128 < 32 and SLINK3_LAYOUTS[found.type]
   local text = value and known and slink3_value(found.type, value)
   if text then return found, value, text end
end

local function slink3_body(frame)
   local data = frame.data
   if not data then return "" end
   if has(SLINK3_TYPED, frame.code) then
      local found = slink3_typed(data)
      if found then
         local value = rest(data, found.size)
         local text = " " .. slink3_typed_text(found)
         if not value then return text end
         return text .. " := " .. (slink3_value(found.type, value) or hex(value) .. " ?")
      end
   elseif has(SLINK3_STANDARD, frame.code) and data:len() >= 3 then
      local text = (" std/0x%04X.%d"):format(data(0, 2):le_uint(), data(2, 1):uint())
      return text .. (data:len() > 3 and " := " .. hex(data(3)) or "")
   end
   return " " .. hex(data)
end

function slink3.describe(frame)
   local where = frame.destination > 0 and ("/%d"):format(frame.destination) or ""
   local head = ("%d%s #%d"):format(frame.address, where, math.floor(frame.control / 4))
   if not frame.answer then
      return head .. " " .. text_of(SLINK3_COMMANDS, frame.code) .. slink3_body(frame)
   end
   head = head .. (frame.fault and " FAULT " or " ") .. text_of(SLINK3_RESPONSES, frame.code)
   if not frame.data then return head end
   local found, _, text = slink3_typed_answer(frame.data)
   return head .. " " .. (found and slink3_typed_text(found) .. " = " .. text or hex(frame.data))
end

function slink3.front(tvb, at)
   if tvb(at, 1):uint() ~= SLINK3_START then return nil, "no START" end
   if tvb:len() - at < 4 then return nil, "cut short" end
   local length = tvb(at + 3, 1):uint()
   if length < 8 then return nil, ("LENGTH %d, under 8"):format(length) end
   if tvb:len() - at < length then return nil, "cut short" end
   local frame = { range = tvb(at, length), raw = tvb(at, length):raw() }
   local bytes = frame.range:bytes()
   local computed = 0
   for index = 1, length - 2 do computed = xor(computed, bytes:get_index(index)) end
   frame.checksum, frame.computed = bytes:get_index(length - 1), computed
   frame.address, frame.control, frame.order = bytes:get_index(1), bytes:get_index(2), bytes:get_index(4)
   frame.code = bytes:get_index(5) + 256 * bytes:get_index(6)
   frame.answer = frame.order % 2 == 1
   frame.destination = math.floor(frame.order / 2) % 8
   frame.fault = math.floor(frame.order / 16) % 2 == 1
   frame.data = length > 8 and frame.range(7, length - 8) or nil
   frame.body = frame.data and frame.data:raw() or ""
   if frame.checksum ~= computed then
      return nil, ("checksum %02Xh, computed %02Xh"):format(frame.checksum, computed), frame
   end
   return length, frame
end

local function slink3_show_head(range, tree)
   local f, size = slink3.f, range:len()
   local function add(parent, field, at, length)
      if at + length <= size then return parent:add_le(field, range(at, length)) end
   end
   add(tree, f.start, 0, 1)
   add(tree, f.address, 1, 1)
   local control = add(tree, f.control, 2, 1)
   if control then add(control, f.number, 2, 1) end
   add(tree, f.length, 3, 1)
   local order = add(tree, f.order, 4, 1)
   if order then
      add(order, f.answer, 4, 1)
      add(order, f.destination, 4, 1)
      add(order, f.fault, 4, 1)
   end
   local code = add(tree, f.code, 5, 2)
   if code then add(tree, range(4, 1):uint() % 2 == 1 and f.response or f.command, 5, 2) end
end

local function slink3_show_value(tree, code, value)
   tree:add(slink3.f.value, value)
   local text, field, found = slink3_value(code, value)
   if field then tree:add(slink3.f[field], value, found) end
   return text
end

local function slink3_show_typed(tree, found, value)
   local f = slink3.f
   local format = tree:add(f.format, found.format)
   format:add(f.type, found.format)
   format:add(f.has_subindex, found.format)
   tree:add_le(f.index, found.index)
   if found.subindex then tree:add(f.subindex, found.subindex) end
   if value then slink3_show_value(tree, found.type, value) end
end

local function slink3_show_standard(tree, data)
   tree:add_le(slink3.f.index, data(0, 2))
   tree:add(slink3.f.subindex, data(2, 1))
   if data:len() > 3 then tree:add(slink3.f.value, data(3)) end
end

-- What DATA are, an answer does not say: the question does, and without one they are a typed value if
-- they can be one.
local function slink3_show_data(frame, entry, tree)
   local data = frame.data
   if not data then return end
   local body = tree:add(slink3.f.data, data)
   local command = frame.code
   if frame.answer then command = entry.question and entry.question.code end
   if frame.answer and frame.code ~= 0 then return end
   if command == SLINK3_STATUS_WORD and frame.answer and data:len() == 2 then
      body:add_le(slink3.f.status_word, data)
   elseif command == SLINK3_MALFUNCTION_CODE and frame.answer and data:len() == 2 then
      body:add_le(slink3.f.malfunction, data)
   elseif has(SLINK3_STANDARD, command) then
      if data:len() >= 3 then slink3_show_standard(body, data) end
   elseif has(SLINK3_TYPED, command) then
      local found = slink3_typed(data)
      if found then slink3_show_typed(body, found, rest(data, found.size)) end
   elseif not command then
      local found, value = slink3_typed_answer(data)
      if found then slink3_show_typed(body, found, value) end
   end
end

function slink3.show(frame, entry, tree, pinfo)
   slink3_show_head(frame.range, tree)
   slink3_show_data(frame, entry, tree)
   show_checksum(slink3, tree, slink3.f.checksum, frame.range(frame.range:len() - 1), frame.checksum, frame.computed)
   from_to(pinfo, frame.address, frame.answer)
   if frame.answer and not has(SLINK3_SUCCESS, frame.code) then
      tree:add_proto_expert_info(slink3.e.refused, text_of(SLINK3_RESPONSES, frame.code))
   end
   if frame.answer and frame.fault then tree:add_proto_expert_info(slink3.e.fault) end
end

function slink3.show_part(range, tree)
   if range(0, 1):uint() ~= SLINK3_START then return end
   slink3_show_head(range, tree)
   local _, _, frame = slink3.front(range:tvb(), 0)
   if not frame then return end
   if frame.data then tree:add(slink3.f.data, range(7, frame.data:len())) end
   show_checksum(slink3, tree, slink3.f.checksum, range(#frame.raw - 1, 1), frame.checksum, frame.computed)
end

function slink3.is_answer(frame) return frame.answer end

local function slink3_key(frame) return ("%d %d %d"):format(frame.address, frame.control, frame.destination) end

function slink3.question(frame, questions)
   local key = slink3_key(frame)
   return key, questions[key]
end

-- An OK answer to a read carries the INDEX, and the SUBINDEX, that was asked for.
function slink3.answers(frame, question)
   local asked, data = question.body, frame.body
   if frame.code ~= 0 or not has(SLINK3_READS, question.code) or #asked < 3 then return true end
   if has(SLINK3_STANDARD, question.code) then return data:sub(1, 3) == asked:sub(1, 3) end
   if data:sub(2, 3) ~= asked:sub(2, 3) then return false end
   local both = data:byte(1) >= 128 and asked:byte(1) >= 128
   return not both or data:sub(4, 4) == asked:sub(4, 4)
end

function slink3.answered() end

function slink3.asked(frame, questions)
   questions[slink3_key(frame)] = frame
end

function slink3.from_master(frame) return not frame.answer end

slink3.may_ask = slink3.from_master

function slink3.expects(frame) return frame.address < 128 end

register(slink3, wtap_encaps.USER0)

-- Datalink ----------------------------------------------------------------------------------------------

local datalink = { title = "Datalink", character = 11 / 9600 }
datalink.proto = Proto("datalink", "Micro-DCI Datalink")
datalink.e = common_experts("datalink")
datalink.e.echo_differs = ProtoExpert.new("datalink.expert.echo_differs", "The echo differs from the change",
   expert.group.RESPONSE_CODE, expert.severity.WARN)
datalink.e.late = ProtoExpert.new("datalink.expert.late_acknowledge", "Acknowledged more than 100 ms after the echo",
   expert.group.SEQUENCE, expert.severity.WARN)
datalink.f = common_fields("datalink", {
   soh = ProtoField.uint8("datalink.soh", "SOH", base.HEX),
   head = ProtoField.uint8("datalink.head", "CMD+I.A.", base.HEX),
   command = ProtoField.uint8("datalink.command", "Command", base.RANGE_STRING + base.HEX, value_strings(DATALINK_COMMANDS)),
   address = ProtoField.uint8("datalink.address", "Instrument address", base.DEC, nil, 0x1F),
   count = ProtoField.uint8("datalink.count", "NUM", base.DEC),
   memory_address = ProtoField.uint16("datalink.memory_address", "Memory address", base.HEX),
   data = ProtoField.bytes("datalink.data", "Data", base.SPACE),
   mask = ProtoField.uint8("datalink.mask", "Mask", base.HEX),
   state = ProtoField.uint8("datalink.state", "State", base.HEX),
   inserted = ProtoField.uint8("datalink.inserted", "Inserted bytes", base.DEC),
   lrc = ProtoField.uint8("datalink.lrc", "LRC", base.HEX),
   acknowledged_in = ProtoField.framenum("datalink.acknowledged_in", "Acknowledged in", base.NONE, frametype.ACK),
   acknowledges = ProtoField.framenum("datalink.acknowledges", "Acknowledges", base.NONE, frametype.REQUEST),
   acknowledge_time = ProtoField.relative_time("datalink.acknowledge_time", "Time from the echo"),
})

local LITERAL = string.char(DATALINK_SOH)

-- The bytes behind SOH without inserted ones, up to the next SOH; whether one follows, and how many bytes.
local function datalink_body(raw)
   local body, at = {}, 2
   while at <= #raw do
      local char = raw:sub(at, at)
      if char == LITERAL then
         if raw:byte(at + 1) ~= 0 and at > 2 then break end
         if raw:byte(at + 1) == 0 then at = at + 1 end
      end
      body[#body + 1] = char
      at = at + 1
   end
   return table.concat(body), at - 1
end

-- The fields of a body; nil and why not.
local function datalink_fields(body)
   if #body == 0 then return nil, "cut short" end
   local head = body:byte(1)
   local frame = { command = head - head % 32, address = head % 32, memory_address = 0, count = 0, data = "" }
   if not text_of(DATALINK_COMMANDS, frame.command) then return nil, ("no command %02Xh"):format(head) end
   if frame.command == DATALINK_ACKNOWLEDGE then
      frame.size = 1
      return frame
   end
   if #body < 2 then return nil, "cut short" end
   frame.count = body:byte(2)
   if frame.count > DATALINK_MOST_DATA then
      return nil, ("NUM %d, over %d"):format(frame.count, DATALINK_MOST_DATA)
   end
   frame.size = 5 + (frame.command == DATALINK_INTERROGATE and 0 or frame.count)
   if #body < frame.size then return nil, "cut short" end
   body = body:sub(1, frame.size)
   frame.memory_address = body:byte(3) + 256 * body:byte(4)
   frame.data, frame.lrc = body:sub(5, -2), body:byte(-1)
   local total = 0
   for index = 1, frame.size - 1 do total = total + body:byte(index) end
   frame.computed = total % 256
   if frame.computed ~= frame.lrc then
      return nil, ("LRC %02Xh, computed %02Xh"):format(frame.lrc, frame.computed), frame
   end
   return frame
end

local function count_of(char, text) return select(2, text:gsub(char, "")) end

local function datalink_frame(raw, stuffing)
   local body, taken = raw:sub(2), #raw
   if stuffing then body, taken = datalink_body(raw) end
   local frame, reason, broken = datalink_fields(body)
   for _, found in pairs { frame or broken } do
      found.body = body:sub(1, found.size)
      found.inserted = stuffing and count_of(LITERAL, found.body) or 0
      found.wire = 1 + found.size + found.inserted
   end
   if reason == "cut short" and taken + 1 < #raw then
      reason = ("a new SOH after %d bytes"):format(taken)
   end
   return frame, reason, broken
end

-- A line may have byte stuffing switched off. Only one of the two readings fills a packet.
function datalink.front(tvb, at)
   local raw = tvb(at):raw()
   if raw:sub(1, 1) ~= LITERAL then return nil, "no SOH" end
   local frame, reason, broken = datalink_frame(raw, true)
   if not frame or frame.wire ~= #raw then
      local other = datalink_frame(raw, false)
      if other and other.wire == #raw then frame = other end
   end
   if not frame then return nil, reason, broken end
   frame.range, frame.raw = tvb(at, frame.wire), raw:sub(1, frame.wire)
   return frame.wire, frame
end

local function upper_hex(text)
   local digits = text:gsub(".", function(char) return (" %02X"):format(char:byte()) end)
   return digits
end

local function pairs_of(frame)
   return frame.command == DATALINK_CHANGE_BITS and frame.count % 2 == 0 and frame.count / 2
end

function datalink.describe(frame)
   local text = ("%d %s"):format(frame.address, text_of(DATALINK_COMMANDS, frame.command))
   if frame.command == DATALINK_ACKNOWLEDGE then return text end
   text = text .. (" %04Xh"):format(frame.memory_address)
   if frame.command == DATALINK_INTERROGATE then return ("%s/%d"):format(text, frame.count) end
   if pairs_of(frame) then
      for index = 1, frame.count, 2 do
         text = text .. (" mask %02X state %02X"):format(frame.data:byte(index, index + 1))
      end
      return text
   end
   return text .. (frame.command == DATALINK_RESPONSE and " =" or " :=") .. upper_hex(frame.data)
end

-- The bytes behind SOH where the fields stand: a copy without the inserted ones, where there are any.
local function datalink_bytes(frame, range)
   if frame.inserted == 0 then return range(1, frame.size) end
   return ByteArray.new(frame.body, true):tvb("Without inserted bytes")()
end

local function datalink_show_fields(frame, range, tree)
   local f, bytes = datalink.f, datalink_bytes(frame, range)
   tree:add(f.soh, range(0, 1))
   local head = tree:add(f.head, bytes(0, 1))
   head:add(f.command, bytes(0, 1), frame.command)
   head:add(f.address, bytes(0, 1))
   if frame.command == DATALINK_ACKNOWLEDGE then return end
   tree:add(f.count, bytes(1, 1))
   tree:add_le(f.memory_address, bytes(2, 2))
   if #frame.data > 0 then
      local data = tree:add(f.data, bytes(4, #frame.data))
      for index = 4, pairs_of(frame) and 3 + frame.count or 3, 2 do
         data:add(f.mask, bytes(index, 1))
         data:add(f.state, bytes(index + 1, 1))
      end
   end
   show_checksum(datalink, tree, f.lrc, bytes(frame.size - 1, 1), frame.lrc, frame.computed)
   if frame.inserted > 0 then generated(tree, f.inserted, frame.inserted) end
end

local function datalink_show_acknowledge(entry, tree)
   local f = datalink.f
   if entry.acknowledged then generated(tree, f.acknowledged_in, entry.acknowledged) end
   if entry.acknowledges then
      generated(tree, f.acknowledges, entry.acknowledges)
   end
   if entry.since_echo then
      generated(tree, f.acknowledge_time, time_of(entry.since_echo))
      if entry.since_echo > 0.1 then tree:add_proto_expert_info(datalink.e.late) end
   end
   if entry.echo_differs then tree:add_proto_expert_info(datalink.e.echo_differs) end
end

function datalink.show(frame, entry, tree, pinfo)
   datalink_show_fields(frame, frame.range, tree)
   datalink_show_acknowledge(entry, tree)
   from_to(pinfo, frame.address, frame.command == DATALINK_RESPONSE)
end

function datalink.show_part(range, tree)
   local raw = range:raw()
   if raw:sub(1, 1) ~= LITERAL then return end
   local _, _, broken = datalink_frame(raw, true)
   if broken then datalink_show_fields(broken, range, tree) end
end

function datalink.is_answer(frame) return frame.command == DATALINK_RESPONSE end

function datalink.question(_, questions) return "asked", questions.asked end

function datalink.answers(frame, question)
   return frame.address == question.address and frame.memory_address == question.memory_address
      and frame.count == question.count
end

function datalink.answered(frame, question, questions, entry)
   if question.command == DATALINK_INTERROGATE then return end
   questions.echoed = question
   question.echoed_at, question.echo_direction = question.time + entry.time, frame.direction
   entry.echo_differs = frame.data ~= question.data
end

function datalink.asked(frame, questions, entry)
   if frame.command ~= DATALINK_ACKNOWLEDGE then
      questions.asked, questions.echoed = frame, nil
      return
   end
   local change = questions.echoed or questions.asked -- whose echo may have been damaged
   if not change or change.address ~= frame.address or change.command == DATALINK_INTERROGATE then return end
   if frame.start >= (change.echoed_at or change.time) + LATE then return end
   if frame.direction ~= UNKNOWN and frame.direction == (change.echo_direction or change.direction) then return end
   change.entry.acknowledged = frame.packet
   entry.acknowledges = change.packet
   entry.since_echo = change.echoed_at and frame.time - change.echoed_at
   questions.echoed, questions.asked = nil, nil
end

function datalink.from_master(frame) return not datalink.is_answer(frame) end

datalink.may_ask = datalink.from_master

function datalink.expects(frame) return frame.command ~= DATALINK_ACKNOWLEDGE end

register(datalink, wtap_encaps.USER1)

-- Ultra3000 ---------------------------------------------------------------------------------------------

local ultra3000 = { title = "Ultra3000", character = 10 / 38400 }
ultra3000.proto = Proto("ultra3000", "Ultra3000 host commands")
ultra3000.e = common_experts("ultra3000")
ultra3000.e.refused = refused_expert("ultra3000")
ultra3000.f = common_fields("ultra3000", {
   address = ProtoField.uint8("ultra3000.address", "Address", base.DEC),
   parameter = ProtoField.uint16("ultra3000.parameter", "Parameter", base.HEX),
   refused = ProtoField.bool("ultra3000.refused", "Refused"),
   func = ProtoField.uint8("ultra3000.function", "Function", base.RANGE_STRING + base.HEX, value_strings(ULTRA3000_FUNCTIONS)),
   data = ProtoField.string("ultra3000.data", "Data"),
   value = ProtoField.uint32("ultra3000.value", "Value", base.DEC_HEX),
   refusal = ProtoField.uint8("ultra3000.refusal", "Refusal", base.RANGE_STRING + base.HEX, value_strings(ULTRA3000_REFUSALS)),
   checksum = ProtoField.uint8("ultra3000.checksum", "Checksum", base.HEX),
})

local REFUSED = 0x800

-- Why no frame begins with this text, whose line feed in front is gone.
local function ultra3000_why_not(text)
   if text == "" then return "cut short" end
   if text:sub(1, 1) ~= ":" then return "no colon" end
   local digits = text:sub(2, ULTRA3000_LONGEST):match("^[0-9A-F]*")
   if #digits == ULTRA3000_LONGEST - 1 then
      return ("no carriage return in %d characters"):format(ULTRA3000_LONGEST)
   end
   local char = text:sub(#digits + 2, #digits + 2)
   if char == "" then return "cut short" end
   if char ~= "\r" then return quoted(char, true):sub(2) .. " is no digit 0-9 A-F" end
   if #digits < 8 then return ("%d characters, under 10"):format(#digits + 2) end
end

function ultra3000.front(tvb, at)
   local text = tvb(at):raw()
   local skipped = text:sub(1, 1) == "\n" and 1 or 0
   text = text:sub(1 + skipped)
   local reason = ultra3000_why_not(text)
   if reason then return nil, reason end
   local digits = text:match("^:([0-9A-F]+)\r")
   local size = #digits + 2
   local frame = { raw = text:sub(1, size), range = tvb(at + skipped, size), data = digits:sub(7, -3) }
   frame.address = tonumber(digits:sub(1, 2), 16)
   frame.parameter = tonumber(digits:sub(3, 5), 16)
   frame.func = tonumber(digits:sub(6, 6), 16)
   frame.checksum = tonumber(digits:sub(-2), 16)
   frame.refused = frame.parameter >= REFUSED
   local total = 0
   for index = 1, #digits - 2 do total = total + digits:byte(index) end
   frame.computed = -total % 256
   if frame.checksum ~= frame.computed then
      return nil, ("checksum %02Xh, computed %02Xh"):format(frame.checksum, frame.computed), frame
   end
   if text:sub(size + 1) == "\n" then skipped = skipped + 1 end -- a line feed behind it is skipped too
   return size + skipped, frame
end

local function refusal_text(data)
   if #data == 2 then return text_of(ULTRA3000_REFUSALS, tonumber(data, 16)) end
   return (data == "" and "nothing" or data) .. " ?"
end

function ultra3000.describe(frame)
   local name = text_of(ULTRA3000_FUNCTIONS, frame.func)
   local head = ("%d %03X %s"):format(frame.address, frame.parameter % REFUSED, name)
   if frame.refused then return head .. " refused: " .. refusal_text(frame.data) end
   if frame.data == "" then return head end
   return head .. (has(ULTRA3000_READS, frame.func) and " = " or " := ") .. frame.data
end

local function ultra3000_show_fields(frame, range, tree, answer)
   local f, data = ultra3000.f, frame.data
   tree:add(f.address, range(1, 2), frame.address)
   tree:add(f.parameter, range(3, 3), frame.parameter % REFUSED)
   tree:add(f.refused, range(3, 1), frame.refused)
   tree:add(f.func, range(6, 1), frame.func)
   if data ~= "" then
      local field = range(7, #data)
      local item = tree:add(f.data, field, data)
      if frame.refused and #data == 2 then
         item:add(f.refusal, field, tonumber(data, 16))
      elseif answer and has(ULTRA3000_READS, frame.func) and (#data == 2 or #data == 4 or #data == 8) then
         item:add(f.value, field, tonumber(data, 16))
      end
   end
   show_checksum(ultra3000, tree, f.checksum, range(range:len() - 3, 2), frame.checksum, frame.computed)
end

function ultra3000.show(frame, entry, tree, pinfo)
   local answer = entry.role == "response" or entry.role == "stray"
   ultra3000_show_fields(frame, frame.range, tree, answer)
   from_to(pinfo, frame.address, answer)
   if frame.refused then tree:add_proto_expert_info(ultra3000.e.refused, refusal_text(frame.data)) end
end

function ultra3000.show_part(range, tree)
   local _, _, frame = ultra3000.front(range:tvb(), 0)
   if frame then ultra3000_show_fields(frame, frame.range, tree, false) end
end

function ultra3000.is_answer() return true end

function ultra3000.question(_, questions) return "asked", questions.asked end

function ultra3000.answers(frame, question)
   if frame.address ~= question.address or frame.func ~= question.func then return false end
   if frame.parameter == question.parameter then
      return frame.data ~= "" or not has(ULTRA3000_READS, frame.func)
   end
   return frame.parameter == question.parameter + REFUSED and #frame.data == 2
end

function ultra3000.answered() end

function ultra3000.asked(frame, questions) questions.asked = frame end

function ultra3000.from_master(frame)
   if frame.refused then return false end
   if has(ULTRA3000_READS, frame.func) then return frame.data == "" end
   return frame.data ~= "" or not has(ULTRA3000_WRITES, frame.func)
end

-- An action, or a copy, looks like its own answer.
function ultra3000.may_ask(frame)
   return not frame.refused and (frame.data == "" or not has(ULTRA3000_READS, frame.func))
end

function ultra3000.expects(frame) return frame.address < 254 end

register(ultra3000, wtap_encaps.USER2)

-- Bytes of no known protocol ------------------------------------------------------------------------------

local raw = { proto = Proto("multidrop", "Serial line") }
raw.proto.fields = {
   ProtoField.bytes("multidrop.data", "Bytes", base.SPACE),
   ProtoField.string("multidrop.text", "As text"),
}

function raw.proto.dissector(tvb, pinfo, root)
   pinfo.cols.protocol = "serial"
   local tree = root:add(raw.proto, tvb())
   local bytes, text = tvb(), quoted(tvb():raw(), true):sub(2)
   tree:add(raw.proto.fields[1], bytes)
   tree:add(raw.proto.fields[2], bytes, text)
   pinfo.cols.info = hex(bytes)
end

DissectorTable.get("wtap_encap"):add(wtap_encaps.USER3, raw.proto)
