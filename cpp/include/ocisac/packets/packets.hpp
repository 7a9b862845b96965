// Packets: a payload as a cycle of blocks of chips, and its recovery from soft chips: docs/reference/packets.md.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "ocisac/packets/line_codes.hpp"

namespace ocisac {

inline constexpr std::size_t kHeaderBytes = 2, kLongestPayload = 4095;

// The preamble of every block. `lengthened`, for exposures above 8 chips, is three times as long.
enum class Preamble { standard, lengthened };

// Chips of the preamble. Only line code "none" can contain six equal chips in a row.
std::span<const std::uint8_t> preamble_chips(Preamble preamble);

inline constexpr double kSureChip = 6;  // nats, at most, that one chip says of a place

// The parameters that sender and receiver share.
struct PacketFormat {
  LineCode line_code = LineCode::named("manchester");
  std::size_t block_bytes = 16;  // coded bytes of a block, 1 to 255
  Preamble preamble = Preamble::standard;
};

// Sizes that follow from the format and the length of a payload.
struct PacketLayout {
  std::size_t payload_bytes = 0;
  std::size_t codewords = 0;      // Reed–Solomon words of 255 bytes
  std::size_t codeword_data = 0;  // bytes of data in each
  std::size_t blocks = 0;         // of a cycle
  std::size_t block_chips = 0;

  [[nodiscard]] std::size_t coded_bytes() const { return 255 * codewords; }
  [[nodiscard]] std::size_t cycle_chips() const { return blocks * block_chips; }
};

std::size_t block_chips(const PacketFormat& format);

// Bytes of payload that one packet of this format can hold.
std::size_t longest_payload(const PacketFormat& format);

// `payload_bytes`: 1 to longest_payload(format).
PacketLayout packet_layout(std::size_t payload_bytes, const PacketFormat& format);

// One cycle of the packet, 1 = bright: blocks one after the other, sent repeatedly. `number`: 0 to 255, counts
// the packets modulo 256.
std::vector<std::uint8_t> packet_chips(std::span<const std::uint8_t> payload, const PacketFormat& format,
                                       unsigned number = 0);

// A block whose preamble and header were read.
struct BlockSighting {
  std::size_t chip = 0;  // at which the preamble begins
  unsigned block = 0;    // sequence number
  unsigned parity = 0;   // of the packet's number
  unsigned digit = 0;    // octal digit of the packet's length: by block mod 4, the highest first
};

// Blocks whose preamble and header lie whole in a stretch of soft chips (ln P(bright)/P(dark)).
std::vector<BlockSighting> find_blocks(std::span<const double> llr, const PacketFormat& format);

// The use that the assembler made of a stretch of chips.
enum class StretchOutcome {
  placed,      // its bytes are in the packet
  waiting,     // kept until its place and the packet's length are known
  repeated,    // begins before the end of what was pushed before it: left out
  unreadable,  // no bytes received: skipped
};

// placed, waiting, …
std::string_view outcome_name(StretchOutcome outcome);

// What stretches of sure chips lack for a payload, other than more of them.
enum class Lack {
  none,
  header,  // five would have been seen since the last one
  place,   // of the last twelve stretches none has one, or the packet's length is not known
};

// none, header, place
std::string_view lack_name(Lack lack);

struct Payload {
  std::vector<std::uint8_t> bytes;
  unsigned number = 0;        // of the packet
  std::size_t corrected = 0;  // bytes that had been read wrong
};

struct StretchReport {
  StretchOutcome outcome = StretchOutcome::placed;
  std::size_t blocks = 0;          // preambles with headers
  std::size_t bytes = 0;           // coded bytes received, of the stretches placed now
  std::size_t cut = 0;             // coded bytes of which an end of the stretch left a part, of those placed now
  std::size_t doubtful = 0;        // coded bytes with a bit that is not sure, of the stretches placed now
  std::size_t violations = 0;      // words that are none of the line code, of the stretches placed now
  double share = 0;                // of the bytes needed that are there, by the scarcest codeword; 1: may be decoded
  bool inverted = false;           // the light is dark for 1, as the last header shows
  Lack lack = Lack::none;          // of what many stretches have been without
  std::optional<Payload> payload;  // whole, its CRC-32 right
};

// Doubt about a stretch's place on the chip clock, in chips.
struct PlaceErrors {
  double offset = 0;             // of the expected place from the given one
  double scatter = 0;            // standard error of the expected place, of this stretch alone: frame starts jitter
  double slip = 0;               // standard error of a jump of the clock since the last stretch
  std::optional<double> time{};  // in any unit, with which a wrong clock drifts; absent: the place
  std::optional<double> told_drift{};  // chips in that unit, if the chip rate is as told and the row time is not
};

// Assembles payloads from stretches of soft chips, each placed on a chip clock. Stretches with a header have their
// place from it; others from the headers before and after them and, where some places are possible, from the preamble,
// the header and the line code that are expected there. Where two headers in a row are not where the clock has them,
// its drift and walk are learned from the headers, which place their neighbours then; so is a pause between blocks.
// What was placed by the clock and a header contradicts is taken back. Headers of either polarity are found. Memory is
// bounded: the soft bits of one cycle and 2^17 chips whose place is not yet known.
class PacketAssembler {
 public:
  explicit PacketAssembler(PacketFormat format);

  // `first`: index of the stretch's first chip on a clock that counts the chips sent, from any origin; stretches in
  // time order. The next header corrects a clock slip of one or two chips. `llr`: (chips) ln P(bright)/P(dark)
  // in nats, 0: not seen. Headers are found across the border of contiguous stretches.
  StretchReport push(std::ptrdiff_t first, std::span<const double> llr, const PlaceErrors& errors = {});

  // The clock has jumped: the packet's symbols stay; the next header restores the place.
  void lose_clock();

  // Chips per unit of the stretches' times, once headers have shown that a clock that ran wrong runs evenly.
  [[nodiscard]] std::optional<double> even_rate() const;

  // The clock counts so many chips per unit of the stretches' times from the last one on, and earlier ones move to
  // where it would have had them.
  void set_rate(double chips);

  // All stretches come again, read otherwise: forgets their chips and their clock, not what headers say of the packet.
  void restart();

 private:
  struct Stretch {
    std::ptrdiff_t first;
    std::size_t epoch;
    std::vector<double> llr;
    std::ptrdiff_t blocks_first;  // chip from which `blocks` count: `first`, or of the stretch before
    std::vector<BlockSighting> blocks;
    PlaceErrors errors;
    double slips;                            // variance of the clock's jumps up to here, chips²
    std::optional<std::ptrdiff_t> origin;    // by its headers
    std::optional<std::ptrdiff_t> joined{};  // its place in the cycle

    [[nodiscard]] double place() const { return static_cast<double>(first) + errors.offset; }
    [[nodiscard]] double time() const { return errors.time.value_or(place()); }
  };
  // Chip at which a block 0 began, by the last headers: its estimate and variance, chips².
  struct Origin {
    double chip, variance;
    double time, slips;  // of the last stretch that changed it
  };
  // The last header of a stretch: its block's place on the clock, and the variance of the clock's jumps up to there.
  struct Header {
    double time, place, chip;  // of the stretch; of the block
    unsigned block;
    double slips;
  };
  // Of a clock that headers contradict: shift of the origin in chips, and its variance in chips², per unit of time.
  struct Drift {
    double rate, walk;
    double chips;         // sent per unit of time
    std::size_t headers;  // between which it was learned
    double step;          // time from one to the next
    bool one_way;         // each is further off than the one before
  };
  enum class Agreement { agrees, disagrees, breaks };
  struct Vote {
    unsigned value = 0;
    int count = 0;
    bool change(unsigned seen);  // true where the value is another now
  };

  Stretch search(std::ptrdiff_t first, std::span<const double> llr, const PlaceErrors& errors);
  void turn();
  void keep(Stretch stretch);
  void read_header(const BlockSighting& sighting);
  void start_packet();
  void find_layout();
  void use_layout(std::size_t payload_bytes);
  std::optional<Payload> try_lengths();
  void learn_pause(const Header& header, std::optional<double> told_drift);
  [[nodiscard]] std::optional<Drift> drift_of_headers() const;
  [[nodiscard]] bool drifts() const;
  void learn_drift();
  [[nodiscard]] Lack lack_after(const StretchReport& report, std::span<const double> llr);
  [[nodiscard]] std::size_t period() const { return block_chips_ + pause_; }
  [[nodiscard]] std::ptrdiff_t cycle() const { return static_cast<std::ptrdiff_t>(layout_->blocks * period()); }
  [[nodiscard]] std::ptrdiff_t origin_by(const Stretch& stretch, const BlockSighting& sighting) const;
  [[nodiscard]] double walk_since(const Stretch& stretch, const Origin& origin) const;
  [[nodiscard]] double place_variance(const Stretch& stretch, const Origin& origin) const;
  [[nodiscard]] double origin_at(const Stretch& stretch, const Origin& origin) const;
  Agreement follow(Stretch& stretch);
  void place_waiting(StretchReport& report);
  void add(const Stretch& stretch, float sign, StretchReport& report);
  void take_back();
  [[nodiscard]] std::optional<std::ptrdiff_t> likely_place(const Stretch& stretch,
                                                           std::span<const Origin> origins) const;
  template <class Evidence>
  [[nodiscard]] double evidence(Evidence& chips, std::ptrdiff_t place) const;
  template <class UseBlock>
  void for_blocks(std::size_t chips, std::ptrdiff_t place, UseBlock&& use) const;
  [[nodiscard]] std::vector<double> block_at(std::span<const double> llr, std::ptrdiff_t start) const;
  void place_block(std::span<const double> chips, std::size_t block, float sign, StretchReport& report);
  [[nodiscard]] std::vector<double> reliabilities() const;
  [[nodiscard]] std::optional<Payload> decode(std::span<const double> reliability) const;

  PacketFormat format_;
  std::size_t block_chips_;
  Vote parity_;
  std::array<Vote, 4> digits_;
  std::optional<PacketLayout> layout_;
  std::size_t epoch_ = 0;  // one more for every jump of the clock
  std::optional<Origin> origin_;
  std::optional<std::ptrdiff_t> doubtful_;  // origin by a header that disagrees
  double scatter_ = 0, slips_ = 0;          // variances about the origin by headers; of jumps so far, chips²
  std::deque<Header> headers_;              // the last ones on this clock
  std::optional<Drift> drift_;              // absent: headers are where the clock has them
  Vote pauses_;
  std::size_t pause_ = 0;              // chips between blocks
  Vote polarity_;                      // 1: dark for 1
  bool inverted_ = false;              // so are the chips received; they are kept as they were sent
  double headers_missed_ = 0;          // that would have been seen since the last one
  std::size_t unplaced_ = 0;           // stretches in a row
  std::vector<Stretch> joined_;        // placed by the clock, since the last header
  std::optional<std::ptrdiff_t> end_;  // chip after the last stretch
  std::vector<double> tail_;           // its last chips, in which a block may have begun
  std::deque<Stretch> waiting_;
  std::size_t waiting_chips_ = 0;
  std::vector<float> soft_bits_;  // (coded bytes, 8) sums of log-likelihood ratios
};

// CRC-32 of IEEE 802.3 (zlib's).
std::uint32_t crc32(std::span<const std::uint8_t> bytes);

}  // namespace ocisac
