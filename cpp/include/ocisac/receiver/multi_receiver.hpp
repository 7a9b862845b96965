// Several lights in one picture, each its own stream of payloads.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "ocisac/camera/camera.hpp"
#include "ocisac/core/views.hpp"
#include "ocisac/lights/light_regions.hpp"
#include "ocisac/receiver/frame_order.hpp"
#include "ocisac/receiver/stream_receiver.hpp"

namespace ocisac {

struct MultiReceiverOptions {
  ReceiverOptions receiver{};
  std::vector<Region> regions{};  // of the lights; empty: found, and looked for anew from time to time
  std::size_t max_sources = 8;    // lights that are found
};

struct SourceFrame {
  std::size_t source = 0;  // number of the light, from 0 in the order in which they were found
  Region region;           // in which it was read
  ReceivedFrame received;  // phase: row of the picture
};

// One Receiver a light. Frames without a light give one result, of the whole frame, that says so.
class MultiReceiver {
 public:
  explicit MultiReceiver(const Camera& camera, MultiReceiverOptions options = {});

  // As Receiver::push; the strongest light first.
  std::vector<SourceFrame> push(std::span<const AnyFramesView> colours, std::optional<std::int64_t> frame = {});

 private:
  struct Source {
    std::size_t number;
    Region region;
    Receiver receiver;
    std::size_t lost = 0;  // frames in a row in which it was not received
  };
  [[nodiscard]] bool must_look() const;
  void look(std::span<const AnyFramesView> colours, const Region& whole);
  void adopt(const std::vector<Region>& found);
  void add(const Region& region);

  Camera camera_;
  MultiReceiverOptions options_;
  FrameOrder order_;
  std::vector<Source> sources_;
  std::size_t next_number_ = 0;
  std::vector<Region> proposed_;  // by the looks so far
  std::size_t agreed_ = 0;        // frames in a row
  std::size_t since_look_ = 0;    // frames
  bool began_ = false;
};

}  // namespace ocisac
