#include "common/concurrency/bounded_queue.h"

#include <memory>
#include <thread>
#include <vector>

#include "gtest/gtest.h"

namespace portolan {
namespace {

TEST(BoundedQueue, KeepsTheOrder) {
  BoundedQueue<int> queue(3, WhenFull::kReject);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(queue.Push(i), PushResult::kQueued);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(queue.Pop(), i);
  EXPECT_EQ(queue.TryPop(), std::nullopt);
}

TEST(BoundedQueue, RejectsTheNewItem) {
  BoundedQueue<int> queue(2, WhenFull::kReject);
  queue.Push(1);
  queue.Push(2);
  EXPECT_EQ(queue.Push(3), PushResult::kRejected);
  EXPECT_EQ(queue.dropped(), 1u);
  EXPECT_EQ(queue.Pop(), 1);
}

TEST(BoundedQueue, DropsTheOldestItem) {
  BoundedQueue<int> queue(2, WhenFull::kDropOldest);
  queue.Push(1);
  queue.Push(2);
  EXPECT_EQ(queue.Push(3), PushResult::kQueuedAfterDrop);
  EXPECT_EQ(queue.size(), 2u);
  EXPECT_EQ(queue.dropped(), 1u);
  EXPECT_EQ(queue.Pop(), 2);
  EXPECT_EQ(queue.Pop(), 3);
}

TEST(BoundedQueue, BlocksUntilThereIsRoom) {
  BoundedQueue<int> queue(1, WhenFull::kBlock);
  queue.Push(0);
  std::thread producer([&] {
    for (int i = 1; i < 100; ++i) EXPECT_EQ(queue.Push(i), PushResult::kQueued);
  });
  for (int i = 0; i < 100; ++i) EXPECT_EQ(queue.Pop(), i);
  producer.join();
  EXPECT_EQ(queue.dropped(), 0u);
}

TEST(BoundedQueue, CloseWakesConsumersAndProducers) {
  BoundedQueue<int> empty(1, WhenFull::kBlock);
  std::thread consumer([&] { EXPECT_EQ(empty.Pop(), std::nullopt); });
  empty.Close();
  consumer.join();
  BoundedQueue<int> full(1, WhenFull::kBlock);
  full.Push(1);
  std::thread producer([&] { EXPECT_EQ(full.Push(2), PushResult::kClosed); });
  full.Close();
  producer.join();
  EXPECT_EQ(full.Pop(), 1);
  EXPECT_EQ(full.Pop(), std::nullopt);
}

TEST(BoundedQueue, HandsEveryItemToExactlyOneConsumer) {
  BoundedQueue<std::unique_ptr<int>> queue(4, WhenFull::kBlock);
  std::vector<std::atomic<int>> seen(400);
  std::vector<std::thread> consumers;
  for (int c = 0; c < 3; ++c) {
    consumers.emplace_back([&] {
      while (auto item = queue.Pop()) ++seen[static_cast<size_t>(**item)];
    });
  }
  std::vector<std::thread> producers;
  for (int p = 0; p < 2; ++p) {
    producers.emplace_back([&, p] {
      for (int i = 0; i < 200; ++i) queue.Push(std::make_unique<int>(200 * p + i));
    });
  }
  for (auto& thread : producers) thread.join();
  queue.Close();
  for (auto& thread : consumers) thread.join();
  for (const auto& count : seen) EXPECT_EQ(count, 1);
}

}  // namespace
}  // namespace portolan
