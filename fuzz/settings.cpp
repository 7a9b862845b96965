// Settings of ocisac-rx: a line is an argument of the command line; what follows a zero byte is the configuration file.
#include "settings.hpp"

#include <sys/mman.h>
#include <unistd.h>

#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include "fuzz.hpp"

using namespace ocisac;

namespace {

// A file in memory, with a path.
class ConfigFile {
 public:
  explicit ConfigFile(std::string_view text) : descriptor_(::memfd_create("config", 0)) {
    fuzz::claim(::write(descriptor_, text.data(), text.size()) == static_cast<ssize_t>(text.size()));
  }
  ~ConfigFile() { ::close(descriptor_); }
  ConfigFile(const ConfigFile&) = delete;
  ConfigFile& operator=(const ConfigFile&) = delete;

  [[nodiscard]] std::string path() const { return "/proc/self/fd/" + std::to_string(descriptor_); }

 private:
  int descriptor_;
};

void check_answer(const apps::Settings& settings) {
  fuzz::claim(std::isfinite(settings.camera.row_time) && settings.camera.row_time > 0);
  fuzz::claim(settings.max_sources > 0 && settings.frames.value_or(1) > 0);
  fuzz::claim(settings.light.data || settings.light.gain);
  if (settings.raw) fuzz::claim(settings.raw->bytes >= settings.raw->height && settings.raw->bytes <= 1U << 30);
  if (settings.region) fuzz::claim(settings.region->width > 0 && settings.region->x < 100'000);
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto end = text.find('\0');
  std::vector<std::string> words{"ocisac-rx"};
  for (std::string_view rest = text.substr(0, end); !rest.empty();) {
    const auto line = rest.substr(0, rest.find('\n'));
    rest.remove_prefix(std::min(rest.size(), line.size() + 1));
    if (!line.starts_with("--config")) words.emplace_back(line);  // other files than the one below are not read
  }
  std::optional<ConfigFile> config;
  if (end != text.npos) words.insert(words.end(), {"--config", config.emplace(text.substr(end + 1)).path()});
  std::vector<const char*> arguments;
  for (const auto& word : words) arguments.push_back(word.c_str());
  fuzz::allow_refusal([&] {
    const auto settings = apps::read_settings(static_cast<int>(arguments.size()), arguments.data());
    if (settings) check_answer(*settings);
  });
  return 0;
}
