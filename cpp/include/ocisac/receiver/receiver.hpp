// Gain and data of the lights in a stream of frames; used by Receiver and MultiReceiver of Python, `ocisac receive
// --packets`, ocisac-rx and ocisac.h.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/receiver/frame_order.hpp"
#include "ocisac/receiver/light_receiver.hpp"

namespace ocisac {

struct ReceiverOptions {
  LightOptions light{};
  std::vector<Region> regions{};  // of the lights; empty: searched
  std::size_t max_sources = 8;    // upper bound for the search
  bool whole_picture = false;     // one light without a search, in all pixels
};

// Receives frames in time order; any may be missing. Each frame is checked once (FrameOrder). Lights are searched in
// the first frame, and again where one was lost or may have appeared; a LightReceiver receives each. A lamp whose
// colours send different chips is one light per stream, at the same place. Memory is bounded.
class Receiver {
 public:
  // Throws std::invalid_argument.
  explicit Receiver(const Camera& camera, ReceiverOptions options = {});

  // `colours`: one frame, one view per colour, rows in time order. At least one result, the strongest light first; for
  // a skipped frame one result with the whole picture as region.
  std::vector<LightFrame> push(std::span<const AnyFramesView> colours, const FrameStamp& stamp = {});
  std::vector<LightFrame> push(std::span<const AnyFramesView> colours, std::int64_t number) {
    return push(colours, FrameStamp{.number = number});
  }

 private:
  FrameOrder::Admission admit(std::span<const AnyFramesView> colours, std::int64_t number, const Region& whole);
  bool find(std::span<const AnyFramesView> colours, const Region& whole);
  [[nodiscard]] bool must_search() const;
  void restart(const Region& whole);
  void search(std::span<const AnyFramesView> colours);
  void search_several(const AnyFramesView& frame);
  void search_one(const AnyFramesView& frame);
  void adopt(const std::vector<Region>& found);
  void add(const Region& region, bool can_move);
  void add_streams();
  [[nodiscard]] RowRange free_rows(const Region& region, std::size_t rows) const;

  // Lights that searches propose.
  struct Proposal {
    std::vector<Region> regions{};
    std::size_t agreed = 0;    // consecutive frames that agree on them; 0: no open proposal
    std::size_t searched = 0;  // frames, since it was opened
  };

  Camera camera_;
  ReceiverOptions options_;
  FrameOrder order_;
  std::vector<LightReceiver> lights_;
  std::size_t next_source_ = 0;
  Proposal proposal_;
  BackOff when_lost_{.shortest = LightReceiver::kLost, .longest = 256, .quick = 0};  // searches where no light is seen
  BackOff further_{.shortest = 60, .longest = 240, .quick = 0};                      // searches for further lights
  bool began_ = false;
};

}  // namespace ocisac
